// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth.h"

#include <cstdio>
#include <memory>
#include <string>

#include "program/command_line/option_set.h"
#include "program/commands/commands.h"
#include "program/session/run_options.h"
#include "trainer/synth/synth_walk.h"

namespace splatboost::program {

Command add_synth(CLI::App& program) {
  CLI::App* app =
      program.add_subcommand("synth", "Make a ray-traced scene with exact cameras, depth, normals and masks");
  app->footer("Example: splatboost synth room && splatboost compare -s room -m out --eval --iterations 1000");
  const auto options = std::make_shared<SynthOptions>();
  add_checked_option(*app, "-o,--output,output", options->output, "folder to create")->type_name("DIR");
  add_checked_option(
      *app, "--scene", options->scene,
      "room; object: in front of a plain backdrop; street: large, seen at several scales; moving: with times; "
      "walk: a sequence with depth for splatboost slam")
      ->type_name("NAME")
      ->capture_default_str();
  add_checked_option(*app, "--width", options->width, "px")->type_name("N")->capture_default_str();
  add_checked_option(*app, "--height", options->height, "px")->type_name("N")->capture_default_str();
  const CLI::Option* const views =
      add_checked_option(*app, "--views", options->views,
                         "number of cameras [48; walk " + std::to_string(kWalkFrames) + "]")
          ->type_name("N");
  add_checked_option(*app, "--cameras", options->cameras,
                     "moving: number of cameras of a rig, fewer than views; 0: one camera that walks around")
      ->type_name("N")
      ->capture_default_str();
  add_checked_option(*app, "--baseline", options->baseline,
                     "walk: metres between the cameras of a stereo pair, in EuRoC's layout; 0: one camera with depth")
      ->type_name("X")
      ->capture_default_str();
  add_checked_option(*app, "--backdrop", options->backdrop, "object: grey value of the backdrop, 0 (black) to 255")
      ->type_name("N")
      ->capture_default_str();
  add_checked_option(*app, "--points", options->points, "number of points of the sparse cloud; not for walk")
      ->type_name("N")
      ->capture_default_str();
  add_checked_option(*app, "--point-noise", options->point_noise, "standard deviation of the points, world units")
      ->type_name("X")
      ->capture_default_str();
  add_checked_option(
      *app, "--surface-points", options->surface_points,
      "room, object, street: number of exact points on the visible surfaces in surface.ply, for mesh-eval")
      ->type_name("N")
      ->capture_default_str();
  add_checked_option(*app, "--samples", options->samples, "samples per pixel and axis, against aliasing")
      ->type_name("N")
      ->capture_default_str();
  add_checked_option(*app, "--seed", options->seed, "random seed; the same seed gives the same bytes")
      ->type_name("N")
      ->capture_default_str();
  return {app, [options, views](const std::string&) {
            if (options->scene == "walk" && views->count() == 0) options->views = kWalkFrames;
            if (options->output.empty()) throw UsageError("no output folder given: splatboost synth DIR");
            write_synthetic_scene(*options);
            std::printf("scene: %s (%d views of %d x %d)\n", options->output.c_str(), options->views, options->width,
                        options->height);
            return 0;
          }};
}

}  // namespace splatboost::program
