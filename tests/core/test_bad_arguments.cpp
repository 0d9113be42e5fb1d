// SPDX-License-Identifier: Apache-2.0
// Invalid arguments: an ArgumentError that names the wrong one, and no partial effect.
#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "splatboost/adam.h"
#include "splatboost/error_map.h"
#include "splatboost/errors.h"
#include "splatboost/exposure.h"
#include "splatboost/neighbors.h"
#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"
#include "splatboost/rows.h"
#include "splatboost/scores.h"
#include "splatboost/select.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

const float kNan = std::numeric_limits<float>::quiet_NaN();

/// The call throws an ArgumentError whose text names the field.
void expect_named(const std::function<void()>& call, const std::string& name) {
  try {
    call();
    ADD_FAILURE() << "nothing was thrown for " << name;
  } catch (const ArgumentError& error) {
    EXPECT_NE(std::string(error.what()).find(name), std::string::npos)
        << "\"" << error.what() << "\" does not name " << name;
  }
}

class BadArguments : public ::testing::Test {
 protected:
  BadArguments() : gradients(scene, 0) {}

  Camera camera = oblique_camera(20, 12);
  SceneData scene = random_scene(camera, {.count = 6, .sh_degree = 2, .features = 2}, 3);
  SceneData other = random_scene(camera, {.count = 6, .colors = true, .covariances = true}, 4);
  RasterOptions options;
  ImageData images{camera, 2};
  Threads threads{1};
  Rasterizer rasterizer{threads};
  GradientData gradients;
  ImageGradientData weights{camera, 2, 5, {}};

  void forward() { rasterizer.forward(camera, scene.view(), options, images.view()); }
};

TEST_F(BadArguments, TheGoodOnesPass) {
  EXPECT_NO_THROW(forward());
  EXPECT_NO_THROW(rasterizer.backward(scene.view(), weights.view(), gradients.view()));
  EXPECT_NO_THROW(check_gaussians(other.view()));
  EXPECT_NO_THROW(check_camera(camera));
}

TEST_F(BadArguments, GaussiansOfWrongShape) {
  const auto broken = [&](std::span<const float> Gaussians::*field, const char* name) {
    Gaussians gaussians = (scene.view().*field).empty() ? other.view() : scene.view();
    std::span<const float> span = gaussians.*field;
    ASSERT_FALSE(span.empty()) << name;
    gaussians.*field = span.first(span.size() - 1);
    expect_named([&] { check_gaussians(gaussians); }, name);
    expect_named([&] { rasterizer.forward(camera, gaussians, options, images.view()); }, name);
  };
  broken(&Gaussians::means, "means");
  broken(&Gaussians::scales, "scales");
  broken(&Gaussians::rotations, "rotations");
  broken(&Gaussians::covariances, "covariances");
  broken(&Gaussians::opacities, "opacities");
  broken(&Gaussians::sh_dc, "sh_dc");
  broken(&Gaussians::sh_rest, "sh_rest");
  broken(&Gaussians::colors, "colors");
  broken(&Gaussians::features, "features");
}

TEST_F(BadArguments, GaussiansOfTwoKindsOrNone) {
  Gaussians gaussians = scene.view();
  gaussians.covariances = other.covariances;
  expect_named([&] { check_gaussians(gaussians); }, "covariances");
  gaussians = scene.view();
  gaussians.scales = {};
  gaussians.rotations = {};
  expect_named([&] { check_gaussians(gaussians); }, "scales");
  gaussians = scene.view();
  gaussians.rotations = {};
  expect_named([&] { check_gaussians(gaussians); }, "rotations");
  gaussians = scene.view();
  gaussians.scales = {};
  expect_named([&] { check_gaussians(gaussians); }, "scales");
  gaussians = scene.view();
  gaussians.colors = other.colors;
  expect_named([&] { check_gaussians(gaussians); }, "colors");
  gaussians = scene.view();
  gaussians.sh_dc = {};
  gaussians.sh_rest = {};
  gaussians.sh_rest_rows = 0;
  gaussians.sh_degree = 0;
  expect_named([&] { check_gaussians(gaussians); }, "sh_dc");
}

TEST_F(BadArguments, DegreesAndFeaturesOutOfRange) {
  Gaussians gaussians = scene.view();
  for (const int degree : {-1, 3, 4, 100}) {  // degree 3 needs 15 rows, there are 8
    gaussians.sh_degree = degree;
    expect_named([&] { check_gaussians(gaussians); }, "sh_degree");
  }
  gaussians = scene.view();
  gaussians.sh_rest_rows = -1;
  expect_named([&] { check_gaussians(gaussians); }, "sh_rest");
  gaussians = scene.view();
  for (const int number : {-1, 3, 9}) {
    gaussians.features_per_gaussian = number;
    expect_named([&] { check_gaussians(gaussians); }, "features");
  }
  std::vector<float> nine(9 * 6);
  gaussians.features = nine;
  gaussians.features_per_gaussian = 9;
  expect_named([&] { check_gaussians(gaussians); }, "features");
  // The images have these channels even if there are no Gaussians.
  Gaussians none;
  none.features_per_gaussian = 9;
  expect_named([&] { check_gaussians(none); }, "features");
}

TEST_F(BadArguments, Cameras) {
  const auto broken = [&](const char* name, const std::function<void(Camera&)>& breaking) {
    Camera bad = camera;
    breaking(bad);
    expect_named([&] { check_camera(bad); }, name);
    expect_named([&] { rasterizer.forward(bad, scene.view(), options, images.view()); }, name);
  };
  broken("width", [](Camera& c) { c.width = 0; });
  broken("height", [](Camera& c) { c.height = -4; });
  broken("camera.fx", [](Camera& c) { c.fx = 0; });
  broken("camera.fy", [](Camera& c) { c.fy = -1; });
  broken("camera.fx", [](Camera& c) { c.fx = kNan; });
  broken("principal point", [](Camera& c) { c.cx = kNan; });
  broken("principal point", [](Camera& c) { c.cy = std::numeric_limits<float>::infinity(); });
  broken("camera_from_world", [](Camera& c) { c.camera_from_world[2][1] = kNan; });
  broken("camera_from_world", [](Camera& c) { c.camera_from_world[3][0] = std::numeric_limits<float>::infinity(); });
}

TEST_F(BadArguments, RasterOptions) {
  const auto broken = [&](const char* name, const std::function<void(RasterOptions&)>& breaking) {
    RasterOptions bad;
    bad.box = BoxPolicy::ellipse;
    breaking(bad);
    expect_named([&] { rasterizer.forward(camera, scene.view(), bad, images.view()); }, name);
  };
  for (const float beta : {0.0f, -0.5f, 1.01f, kNan}) broken("beta", [&](auto& o) { o.beta = beta; });
  for (const float low_pass : {-0.1f, kNan}) broken("low_pass", [&](auto& o) { o.low_pass = low_pass; });
  broken("near_plane", [](auto& o) { o.near_plane = kNan; });
}

TEST_F(BadArguments, Images) {
  const auto broken = [&](std::span<float> RasterImages::*field, const char* name) {
    RasterImages bad = images.view();
    bad.*field = (bad.*field).first((bad.*field).size() - 1);
    expect_named([&] { rasterizer.forward(camera, scene.view(), options, bad); }, name);
  };
  broken(&RasterImages::color, "color");
  broken(&RasterImages::features, "features");
  broken(&RasterImages::inverse_depth, "inverse_depth");
  broken(&RasterImages::alpha, "alpha");
}

TEST_F(BadArguments, ImageGradients) {
  forward();
  const auto broken = [&](std::span<const float> RasterImageGradients::*field, const char* name) {
    RasterImageGradients bad = weights.view();
    bad.*field = (bad.*field).first((bad.*field).size() - 1);
    expect_named([&] { rasterizer.backward(scene.view(), bad, gradients.view()); }, name);
  };
  broken(&RasterImageGradients::color, "color");
  broken(&RasterImageGradients::features, "features");
  broken(&RasterImageGradients::inverse_depth, "inverse_depth");
  broken(&RasterImageGradients::alpha, "alpha");
}

TEST_F(BadArguments, GradientsOfImagesThatWereNotDrawn) {
  rasterizer.forward(camera, scene.view(), options, color_only(images.color));
  RasterImageGradients bad;
  bad.features = weights.features;
  expect_named([&] { rasterizer.backward(scene.view(), bad, gradients.view()); }, "features");
  bad = {};
  bad.inverse_depth = weights.inverse_depth;
  expect_named([&] { rasterizer.backward(scene.view(), bad, gradients.view()); }, "inverse_depth");
  RasterImages images_without = images.view();
  images_without.color = {};
  rasterizer.forward(camera, scene.view(), options, images_without);
  bad = {};
  bad.color = weights.color;
  expect_named([&] { rasterizer.backward(scene.view(), bad, gradients.view()); }, "color");
}

TEST_F(BadArguments, GaussianGradients) {
  forward();
  const auto broken = [&](std::span<float> GaussianGradients::*field, const char* name) {
    GaussianGradients bad = gradients.view();
    bad.*field = (bad.*field).first((bad.*field).size() - 1);
    expect_named([&] { rasterizer.backward(scene.view(), weights.view(), bad); }, name);
  };
  broken(&GaussianGradients::means, "means");
  broken(&GaussianGradients::scales, "scales");
  broken(&GaussianGradients::rotations, "rotations");
  broken(&GaussianGradients::opacities, "opacities");
  broken(&GaussianGradients::sh_dc, "sh_dc");
  broken(&GaussianGradients::sh_rest, "sh_rest");
  broken(&GaussianGradients::features, "features");
  broken(&GaussianGradients::screen_means, "screen_means");
  broken(&GaussianGradients::screen_means_abs, "screen_means_abs");
}

// A gradient span for an input that was not given is an error: the caller would read zeros.
TEST_F(BadArguments, GaussianGradientsOfWhatWasNotGiven) {
  forward();
  GaussianGradients bad = gradients.view();
  std::vector<float> covariances(6 * scene.count);
  bad.covariances = covariances;
  expect_named([&] { rasterizer.backward(scene.view(), weights.view(), bad); }, "covariances");
  bad = gradients.view();
  std::vector<float> colors(3 * scene.count);
  bad.colors = colors;
  expect_named([&] { rasterizer.backward(scene.view(), weights.view(), bad); }, "colors");
}

TEST_F(BadArguments, OtherGaussiansThanForwards) {
  forward();
  const SceneData more = random_scene(camera, {.count = 7, .sh_degree = 2, .features = 2}, 3);
  GradientData more_gradients(more, 0);
  EXPECT_THROW(rasterizer.backward(more.view(), weights.view(), more_gradients.view()), ArgumentError);
}

TEST_F(BadArguments, BackwardAndCountsBeforeForward) {
  EXPECT_THROW(rasterizer.backward(scene.view(), weights.view(), gradients.view()), ArgumentError);
  std::vector<std::uint8_t> flagged(20 * 12, 1);
  std::vector<std::int32_t> counts(scene.count);
  EXPECT_THROW(rasterizer.count_flagged(flagged, counts), ArgumentError);
}

TEST_F(BadArguments, Counts) {
  forward();
  std::vector<std::uint8_t> flagged(20 * 12, 1);
  std::vector<std::int32_t> counts(scene.count);
  expect_named([&] { rasterizer.count_flagged(std::span(flagged).first(7), counts); }, "flagged");
  expect_named([&] { rasterizer.count_flagged(flagged, std::span(counts).first(2)); }, "counts");
}

TEST_F(BadArguments, AFailedForwardLeavesTheObjectUsable) {
  options.beta = 7;
  options.box = BoxPolicy::ellipse;
  EXPECT_THROW(forward(), ArgumentError);
  options.beta = 1;
  EXPECT_NO_THROW(forward());
  EXPECT_NO_THROW(rasterizer.backward(scene.view(), weights.view(), gradients.view()));
}

TEST_F(BadArguments, PhotometricAndErrorMap) {
  Photometric photometric(threads);
  std::vector<float> render(3 * 240);
  std::vector<std::uint8_t> truth(3 * 240);
  std::vector<std::uint8_t> valid(240, 1);
  std::vector<float> gradient(3 * 240);
  std::vector<float> error(240);
  std::vector<std::uint8_t> flagged(240);
  const TruthImage good{20, 12, truth, valid};
  EXPECT_NO_THROW(photometric.evaluate(render, good, 0.2f, gradient));
  TruthImage bad = good;
  const auto both = [&](const char* name) {
    expect_named([&] { photometric.evaluate(render, bad, 0.2f, gradient); }, name);
    expect_named([&] { flag_errors(render, bad, 0.1f, error, flagged, threads); }, name);
    bad = good;
  };
  bad.width = 0;
  both("width");
  bad.height = -1;
  both("height");
  bad.color = bad.color.first(5);
  both("color");
  bad.valid = bad.valid.first(5);
  both("valid");
  const auto short_render = std::span<const float>(render).first(9);
  expect_named([&] { photometric.evaluate(short_render, good, 0.2f, gradient); }, "render");
  expect_named([&] { flag_errors(short_render, good, 0.1f, error, flagged, threads); }, "render");
  expect_named([&] { photometric.evaluate(render, good, 0.2f, std::span(gradient).first(9)); }, "gradient");
  for (const float lambda : {-0.1f, 1.1f, kNan})
    expect_named([&] { photometric.evaluate(render, good, lambda, gradient); }, "lambda");
  expect_named([&] { flag_errors(render, good, 0.1f, std::span(error).first(9), flagged, threads); }, "error");
  expect_named([&] { flag_errors(render, good, 0.1f, error, std::span(flagged).first(9), threads); }, "flagged");
}

TEST_F(BadArguments, Exposure) {
  std::vector<float> render(3 * 240), gradient(3 * 240), exposure(2), exposure_gradient(2);
  std::vector<std::uint8_t> truth(3 * 240), valid(240, 1);
  std::vector<double> workspace(4);
  const auto call = [&](const TruthImage& image) {
    add_exposed_l1(render, image, exposure, 1, gradient, exposure_gradient, workspace, threads);
  };
  EXPECT_NO_THROW(call({20, 12, truth, valid}));
  expect_named([&] { call({20, 12, truth, std::span(valid).first(239)}); }, "valid");
  expect_named([&] { call({20, 11, truth, valid}); }, "truth");
}

TEST_F(BadArguments, Adam) {
  std::vector<float> four(4);
  std::vector<float> three(3);
  expect_named([&] { adam_step(four, three, four, four, 1, {}, threads); }, "gradients");
  expect_named([&] { adam_step(four, four, three, four, 1, {}, threads); }, "first_moments");
  expect_named([&] { adam_step(four, four, four, three, 1, {}, threads); }, "second_moments");
  expect_named([&] { adam_step(four, four, four, four, 0, {}, threads); }, "step");
}

TEST_F(BadArguments, Neighbors) {
  std::vector<float> points(9);
  std::vector<float> distances(3);
  expect_named([&] { mean_squared_neighbor_distances(std::span<const float>(points).first(8), 3, distances, threads); },
               "points");
  expect_named([&] { mean_squared_neighbor_distances(points, 0, distances, threads); }, "k");
  expect_named([&] { mean_squared_neighbor_distances(points, 3, std::span(distances).first(2), threads); },
               "mean_squared_distances");
  points[4] = kNan;
  expect_named([&] { mean_squared_neighbor_distances(points, 3, distances, threads); }, "points");
}

TEST_F(BadArguments, RowsOfWrongShape) {
  std::vector<float> tensor(12);
  expect_named([&] { remove_rows(tensor, 3, std::vector<std::uint8_t>(3)); }, "removed");
  Array<float> array(threads, tensor);
  expect_named([&] { append_rows(array, 5, std::vector<std::uint32_t>{0}); }, "width");
}

TEST_F(BadArguments, RowsThatDoNotExist) {
  Array<float> tensor(threads, std::vector<float>(12));
  // The last index wraps to 0 if one is added to it in 32 bits.
  for (const std::uint32_t row : {4u, 1000u, 0xffffffffu}) {
    expect_named([&] { append_rows(tensor, 3, std::vector<std::uint32_t>{0, row}); }, "row");
    EXPECT_EQ(tensor.size(), 12u) << "changed by a call that threw";
    tensor.resize(12);
  }
}

TEST_F(BadArguments, ScoresAndSelections) {
  ScoreSums sums;
  sums.reset(3);
  expect_named([&] { sums.add_view(std::vector<std::int32_t>(2), 0.5); }, "view_counts");
  std::vector<std::int64_t> two(2);
  std::vector<float> floats(2);
  expect_named([&] { importance_scores(sums, two); }, "scores");
  expect_named([&] { pruning_scores(sums, floats); }, "scores");
  std::vector<std::uint8_t> mask(3, 1);
  expect_named([&] { keep_important(two, 5, mask); }, "candidates");
  expect_named([&] { keep_weighted_sample(floats, 1, RandomStream(1, 1, RandomPurpose::prune), mask); }, "weights");
  expect_named([&] { keep_largest(floats, 1, mask); }, "priorities");
  expect_named([&] { spare_one(floats, mask); }, "priorities");
}

}  // namespace
}  // namespace splatboost::test
