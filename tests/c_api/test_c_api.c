/* SPDX-License-Identifier: Apache-2.0 */
/* The C ABI used from C: renders, differentiates and selects, and checks answers that are known without it. */
#include "checks.h"

#include <c/adapters_c.h>

#include <stdlib.h>

enum { W = 33, H = 25, PIXELS = W * H };

/* ---- one Gaussian, whose image is a formula ---- */

static float mean[3] = {0, 0, 2}, scale[3] = {0.1f, 0.1f, 0.1f}, rotation[4] = {2, 0, 0, 0}, opacity[1] = {0.8f},
             color[3] = {1, 0.5f, 0.25f}, image[3 * PIXELS], depth[PIXELS], alpha[PIXELS];
static int32_t radius[1];
static uint8_t seen[1];

typedef struct {
  sb_tensor means, scales, rotations, opacities, colors;
  sb_gaussians gaussians;
} Scene;

static void make_scene(Scene* s) {
  memset(s, 0, sizeof *s);
  s->means = floats(mean, 2, 1, 3, 0);
  s->scales = floats(scale, 2, 1, 3, 0);
  s->rotations = floats(rotation, 2, 1, 4, 0);
  s->opacities = floats(opacity, 2, 1, 1, 0);
  s->colors = floats(color, 2, 1, 3, 0);
  s->gaussians.means = &s->means;
  s->gaussians.scales = &s->scales;
  s->gaussians.rotations = &s->rotations;
  s->gaussians.opacities = &s->opacities;
  s->gaussians.colors = &s->colors;
}

static double formula_alpha(double dx, double dy, double variance) {
  return 0.8 * exp(-0.5 * (dx * dx + dy * dy) / variance);
}

static double draw(sb_rasterizer* rasterizer, const Scene* scene, const sb_raster_options* options) {
  const sb_camera camera = test_camera();
  sb_tensor c = floats(image, 3, 3, H, W), d = floats(depth, 3, 1, H, W), a = floats(alpha, 2, H, W, 0);
  sb_tensor r = tensor(radius, SB_INT32, 1, 1, 0, 0), v = tensor(seen, SB_UINT8, 1, 1, 0, 0);
  sb_raster_outputs outputs;
  double sum = 0;
  int i;
  memset(&outputs, 0, sizeof outputs);
  outputs.color = &c;
  outputs.inverse_depth = &d;
  outputs.alpha = &a;
  outputs.radii = &r;
  outputs.visible = &v;
  CHECK(sb_rasterizer_forward(rasterizer, &camera, &scene->gaussians, options, &outputs, NULL) == SB_OK);
  for (i = 0; i < 3 * PIXELS; ++i) sum += image[i];
  return sum;
}

static void renders_and_differentiates(void) {
  const double variance = 1.6 * 1.6 + 0.3; /* (fx·scale/z)² and the low-pass */
  sb_rasterizer* rasterizer = NULL;
  sb_raster_options options;
  Scene scene;
  double sum_alpha = 0;
  int x, y, i, inside = 0, mostly = 0;
  make_scene(&scene);
  CHECK(sb_raster_options_default(&options) == SB_OK);
  CHECK_NEAR(options.low_pass, 0.3, 1e-6);
  options.box = SB_BOX_ELLIPSE;
  options.background[2] = 1;
  CHECK(sb_rasterizer_create(TEST_DEVICE, &rasterizer) == SB_OK);
  draw(rasterizer, &scene, &options);
  CHECK(radius[0] == (int)ceil(3 * sqrt(variance + sqrt(0.1))) && seen[0] == 1);
  for (y = 0; y < H; ++y) {
    for (x = 0; x < W; ++x) {
      /* The projection is exact on the axis only; off it the splat is the same. */
      const double expected = formula_alpha(x - 16, y - 12, variance);
      const double a = expected >= 1.0 / 255 ? expected : 0;
      const int p = y * W + x;
      if (fabs(expected - 1.0 / 255) < 1e-4) {
        ++mostly;
        continue;
      }
      inside += a > 0;
      sum_alpha += a;
      CHECK_NEAR(alpha[p], a, 2e-6);
      CHECK_NEAR(image[p], a, 2e-6);
      CHECK_NEAR(image[PIXELS + p], 0.5 * a, 2e-6);
      CHECK_NEAR(image[2 * PIXELS + p], 0.25 * a + (1 - a), 2e-6);
      CHECK_NEAR(depth[p], 0.5 * a, 2e-6);
    }
  }
  CHECK(mostly == 0 && inside > 50);

  /* A pixel counts where the Gaussian was blended. */
  {
    static uint8_t flags[PIXELS];
    int32_t count[1] = {1000};
    const sb_tensor f = tensor(flags, SB_UINT8, 2, H, W, 0), c = tensor(count, SB_INT32, 1, 1, 0, 0);
    int64_t visible = 0, entries = 0;
    memset(flags, 1, sizeof flags);
    CHECK(sb_rasterizer_count_flagged(rasterizer, &f, &c, NULL) == SB_OK);
    CHECK(count[0] == 1000 + inside);
    /* One Gaussian is in front everywhere: its pixels observe it, unless more than all the light is asked for. */
    CHECK(sb_rasterizer_count_observed(rasterizer, 0.5f, &c, NULL) == SB_OK && count[0] == 1000 + 2 * inside);
    CHECK(sb_rasterizer_count_observed(rasterizer, 1.0f, &c, NULL) == SB_ERROR_ARGUMENT);
    CHECK(sb_rasterizer_count_observed(rasterizer, 0.5f, &f, NULL) == SB_ERROR_ARGUMENT);
    CHECK(count[0] == 1000 + 2 * inside);
    CHECK(sb_rasterizer_add_weights(rasterizer, &f, NULL) == SB_ERROR_ARGUMENT);
    CHECK(sb_rasterizer_add_weights(rasterizer, &c, NULL) == SB_OK);
    /* Nothing lies before it, and each pixel is rounded. */
    CHECK_NEAR(count[0] - 1000 - 2 * inside, 256 * sum_alpha, 0.5 * inside);
    int32_t redrawn = -1;
    CHECK(sb_rasterizer_settle(rasterizer, &redrawn, NULL) == SB_OK && redrawn == 0);
    CHECK(sb_rasterizer_counts(rasterizer, &visible, &entries, NULL) == SB_OK && visible == 1 && entries >= 1);
  }

  /* Gradients of the image's sum against differences of it. */
  {
    static float ones[3 * PIXELS];
    float g_mean[3], g_scale[3], g_rotation[4], g_opacity[1], g_color[3], g_screen[2], g_abs[2];
    const sb_tensor go = floats(ones, 3, 3, H, W);
    const sb_tensor gm = floats(g_mean, 2, 1, 3, 0), gs = floats(g_scale, 2, 1, 3, 0),
                    gr = floats(g_rotation, 2, 1, 4, 0), gp = floats(g_opacity, 1, 1, 0, 0),
                    gc = floats(g_color, 2, 1, 3, 0), g2 = floats(g_screen, 2, 1, 2, 0), ga = floats(g_abs, 2, 1, 2, 0);
    sb_image_gradients from;
    sb_gaussian_gradients to;
    for (i = 0; i < 3 * PIXELS; ++i) ones[i] = 1;
    memset(&from, 0, sizeof from);
    memset(&to, 0, sizeof to);
    from.color = &go;
    to.means = &gm;
    to.scales = &gs;
    to.rotations = &gr;
    to.opacities = &gp;
    to.colors = &gc;
    to.screen_means = &g2;
    to.screen_means_abs = &ga;
    CHECK(sb_rasterizer_backward(rasterizer, &scene.gaussians, &from, &to, NULL) == SB_OK);
    CHECK_NEAR(g_opacity[0], (1 + 0.5 + 0.25 - 1) * sum_alpha / 0.8, 1e-3);
    for (i = 0; i < 3; ++i) CHECK_NEAR(g_color[i], sum_alpha, 1e-3);
    for (i = 0; i < 4; ++i) CHECK_NEAR(g_rotation[i], 0, 1e-4); /* a sphere */
    CHECK_NEAR(g_screen[0], 0, 1e-3);                           /* symmetric ... */
    CHECK(g_abs[0] > 1 && fabsf(g_abs[0] - g_abs[1]) < 1e-3f);  /* ... but every pixel pulls */
    for (i = 0; i < 2; ++i) {
      const double step = 1e-3;
      double up, down;
      float* const moved = i == 0 ? &mean[2] : &scale[0];
      const float was = *moved;
      *moved = (float)(was + step);
      up = draw(rasterizer, &scene, &options);
      *moved = (float)(was - step);
      down = draw(rasterizer, &scene, &options);
      *moved = was;
      /* Pixels that pass the 1/255 threshold between the two make the difference uneven. */
      CHECK_NEAR(i == 0 ? g_mean[2] : g_scale[0], (up - down) / (2 * step),
                 0.02 * fabs((up - down) / (2 * step)) + 0.05);
    }
  }
  sb_rasterizer_destroy(rasterizer);
  sb_rasterizer_destroy(NULL);
}

/* ---- one convex, whose image is a formula: a square of 8 pixels a side around the centre of pixel (16, 12) ---- */

static float corners[12] = {-0.25f, -0.25f, 2, 0.25f, -0.25f, 2, 0.25f, 0.25f, 2, -0.25f, 0.25f, 2},
             smooth[1] = {0.05f}, sharp[1] = {1};

static double formula_inside(double dx, double dy) {
  const double z = 2, side = 8; /* a line of an edge: its length times the distance from it */
  const double sum = exp(z * 0.05 * side * (dx - 4)) + exp(z * 0.05 * side * (-dx - 4)) +
                     exp(z * 0.05 * side * (dy - 4)) + exp(z * 0.05 * side * (-dy - 4));
  return 1 / (1 + exp(z * log(sum)));
}

static double draw_convex(sb_convex_rasterizer* rasterizer, const sb_convexes* convexes) {
  const sb_convex_options options = {SB_CONVEX_BOX_COMPACT, 1, 0.2f, 1, {0, 0, 1}, 0};
  const sb_camera camera = test_camera();
  const sb_tensor c = floats(image, 3, 3, H, W), a = floats(alpha, 2, H, W, 0), v = tensor(seen, SB_UINT8, 1, 1, 0, 0);
  const sb_convex_outputs outputs = {&c, &a, &v};
  double sum = 0;
  int i;
  CHECK(sb_convex_rasterizer_forward(rasterizer, &camera, convexes, &options, &outputs, NULL) == SB_OK);
  for (i = 0; i < 3 * PIXELS; ++i) sum += image[i];
  return sum;
}

static void draws_convexes(void) {
  static float ones[3 * PIXELS];
  static uint8_t flags[PIXELS];
  const sb_tensor points = floats(corners, 3, 1, 4, 3), smoothness = floats(smooth, 1, 1, 0, 0),
                  sharpness = floats(sharp, 2, 1, 1, 0), opacities = floats(opacity, 1, 1, 0, 0),
                  colors = floats(color, 2, 1, 3, 0);
  const sb_convexes convexes = {&points, &smoothness, &sharpness, &opacities, NULL, NULL, &colors, 0};
  float g_corners[12], g_smooth[1], g_sharp[1], g_opacity[1], g_color[3], g_abs[1], g_screen[3];
  const sb_tensor gp = floats(g_corners, 3, 1, 4, 3), gs = floats(g_smooth, 1, 1, 0, 0),
                  gh = floats(g_sharp, 1, 1, 0, 0), go = floats(g_opacity, 1, 1, 0, 0),
                  gc = floats(g_color, 2, 1, 3, 0), ga = floats(g_abs, 1, 1, 0, 0), g2 = floats(g_screen, 2, 1, 3, 0),
                  up = floats(ones, 3, 3, H, W);
  const sb_convex_gradients to = {0, &gp, &gs, &gh, &go, NULL, NULL, &gc, &ga, &g2};
  const sb_tensor f = tensor(flags, SB_UINT8, 2, H, W, 0);
  sb_convex_rasterizer* rasterizer = NULL;
  int32_t count[1] = {1000};
  const sb_tensor counts = tensor(count, SB_INT32, 1, 1, 0, 0);
  double sum_alpha = 0;
  int x, y, i, inside = 0;
  CHECK(sb_convex_rasterizer_create(TEST_DEVICE, &rasterizer) == SB_OK);
  draw_convex(rasterizer, &convexes);
  CHECK(seen[0] == 1);
  for (y = 0; y < H; ++y) {
    for (x = 0; x < W; ++x) {
      const double expected = 0.8 * formula_inside(x - 16, y - 12), a = expected >= 1.0 / 255 ? expected : 0;
      const int p = y * W + x;
      CHECK(fabs(expected - 1.0 / 255) > 1e-5);
      inside += a > 0;
      sum_alpha += a;
      CHECK_NEAR(alpha[p], a, 1e-5);
      CHECK_NEAR(image[p], a, 1e-5);
      CHECK_NEAR(image[2 * PIXELS + p], 0.25 * a + (1 - a), 1e-5);
    }
  }
  memset(flags, 1, sizeof flags);
  CHECK(sb_convex_rasterizer_count_flagged(rasterizer, &f, &counts, NULL) == SB_OK && count[0] == 1000 + inside);
  CHECK(inside > 60 && inside < PIXELS);
  CHECK(sb_convex_rasterizer_add_weights(rasterizer, &counts, NULL) == SB_OK);
  /* Nothing lies before it, and each pixel is rounded. */
  CHECK_NEAR(count[0] - 1000 - inside, 256 * sum_alpha, 0.5 * inside);

  for (i = 0; i < 3 * PIXELS; ++i) ones[i] = 1;
  CHECK(sb_convex_rasterizer_backward(rasterizer, &convexes, &up, NULL, &to, NULL) == SB_OK);
  CHECK_NEAR(g_opacity[0], (1 + 0.5 + 0.25 - 1) * sum_alpha / 0.8, 1e-3);
  for (i = 0; i < 3; ++i) CHECK_NEAR(g_color[i], sum_alpha, 2e-3);
  CHECK(g_abs[0] >= fabsf(g_sharp[0]));
  /* On screen the corners are 16 pixels a unit apart, and pull outwards, each as much. */
  CHECK_NEAR(g_screen[0], 0, 1e-3);
  CHECK_NEAR(g_screen[2], 4 * (fabs(g_corners[0]) + fabs(g_corners[1])) / 16, 1e-3 * fabs(g_corners[0]));
  CHECK(g_corners[0] < -1 && fabsf(g_corners[0] + g_corners[3]) < 1e-3f);
  for (i = 0; i < 3; ++i) {
    float* const moved = i == 0 ? &corners[3] : i == 1 ? smooth : sharp;
    const double given = i == 0 ? g_corners[3] : i == 1 ? g_smooth[0] : g_sharp[0], step = i == 0 ? 2e-3 : 1e-3;
    const float was = *moved;
    double above, below;
    *moved = (float)(was + step);
    above = draw_convex(rasterizer, &convexes);
    *moved = (float)(was - step);
    below = draw_convex(rasterizer, &convexes);
    *moved = was;
    /* Pixels that pass the 1/255 threshold between the two make the difference uneven. */
    CHECK_NEAR(given, (above - below) / (2 * step), 0.03 * fabs((above - below) / (2 * step)) + 0.05);
  }
  sb_convex_rasterizer_destroy(rasterizer);
}

static void tells_what_is_seen(void) {
  const sb_camera camera = test_camera();
  float means[6] = {0, 0, 2, 0, 0, -2}, scales[6] = {0.1f, 0.1f, 0.1f, 0.1f, 0.1f, 0.1f},
        rotations[8] = {1, 0, 0, 0, 1, 0, 0, 0};
  uint8_t visible[2];
  int32_t radii[2];
  const sb_tensor m = floats(means, 2, 2, 3, 0), s = floats(scales, 2, 2, 3, 0), q = floats(rotations, 2, 2, 4, 0),
                  v = tensor(visible, SB_UINT8, 1, 2, 0, 0), r = tensor(radii, SB_INT32, 1, 2, 0, 0);
  sb_gaussians gaussians;
  sb_raster_options options;
  memset(&gaussians, 0, sizeof gaussians);
  gaussians.means = &m;
  gaussians.scales = &s;
  gaussians.rotations = &q;
  CHECK(sb_mark_visible(TEST_DEVICE, &camera, &m, 0.2f, &v) == SB_OK && visible[0] == 1 && visible[1] == 0);
  CHECK(sb_raster_options_default(&options) == SB_OK);
  CHECK(sb_visible_radii(TEST_DEVICE, &camera, &gaussians, &options, &r) == SB_OK && radii[0] == 6 && radii[1] == 0);
}

static sb_status mean_ssim_of(const sb_tensor* images, const sb_tensor* truths, int32_t valid_padding,
                              const sb_tensor* gradient, double* mean) {
  const sb_tensor to = tensor(mean, SB_FLOAT64, 1, 1, 0, 0);
  return sb_ssim(TEST_DEVICE, images, truths, valid_padding, gradient, &to);
}

static void measures_errors(void) {
  static float render[3 * PIXELS], error[PIXELS], gradient[3 * PIXELS], truth_floats[3 * PIXELS];
  static uint8_t truth[3 * PIXELS], flagged[PIXELS];
  const sb_tensor r = floats(render, 3, 3, H, W), e = floats(error, 2, H, W, 0), g = floats(gradient, 3, 3, H, W),
                  c = tensor(truth, SB_UINT8, 3, 3, H, W), f = tensor(flagged, SB_UINT8, 2, H, W, 0);
  sb_tensor images = floats(render, 3, 3, H, W), truths = floats(truth_floats, 3, 3, H, W);
  sb_truth t = {0};
  sb_loss loss;
  int64_t count = -1;
  double same = 0, up = 0, down = 0, mean_ssim = 0;
  int i;
  t.color = &c;
  for (i = 0; i < 3 * PIXELS; ++i) {
    truth[i] = (uint8_t)(i * 7 % 256);
    truth_floats[i] = render[i] = (float)truth[i] / 255.0f;
  }
  for (i = 0; i < 3; ++i) render[i * PIXELS + 5] = truth_floats[i * PIXELS + 5] > 0.5f ? 0.0f : 1.0f;
  CHECK(sb_flag_errors(TEST_DEVICE, &r, &t, 0.1f, &e, &f, &count) == SB_OK);
  CHECK(count == 1 && flagged[5] == 1 && error[4] == 0.0f && error[5] > 0.4f);

  CHECK(sb_photometric_loss(TEST_DEVICE, &r, &t, 0.2f, &g, &loss) == SB_OK);
  CHECK_NEAR(loss.l1, error[5] / PIXELS, 1e-6);
  CHECK_NEAR(loss.total, 0.8 * loss.l1 + 0.2 * (1 - loss.ssim), 1e-9);

  images.dimensions = truths.dimensions = 4;
  for (i = 3; i > 0; --i) {
    images.shape[i] = truths.shape[i] = images.shape[i - 1];
    images.strides[i] = truths.strides[i] = images.strides[i - 1];
  }
  images.shape[0] = truths.shape[0] = 1;
  CHECK(mean_ssim_of(&truths, &truths, 0, NULL, &same) == SB_OK);
  CHECK_NEAR(same, 1, 1e-6);
  CHECK(mean_ssim_of(&images, &truths, 0, NULL, &mean_ssim) == SB_OK);
  CHECK_NEAR(mean_ssim, loss.ssim, 1e-5); /* the same figure from 8-bit truths */
  {
    sb_tensor out = images;
    out.data = gradient;
    for (i = 0; i < 2; ++i) {
      const float was = render[300];
      CHECK(mean_ssim_of(&images, &truths, i, &out, &mean_ssim) == SB_OK);
      render[300] = was + 0.01f;
      CHECK(mean_ssim_of(&images, &truths, i, NULL, &up) == SB_OK);
      render[300] = was - 0.01f;
      CHECK(mean_ssim_of(&images, &truths, i, NULL, &down) == SB_OK);
      render[300] = was;
      CHECK_NEAR(gradient[300], (up - down) / 0.02, 2e-2 * fabs((up - down) / 0.02) + 1e-6);
    }
  }
}

static void scores_and_selects(void) {
  int64_t counts[3] = {29, 30, 31}, importance[3], kept = 0;
  double weighted[3] = {1, 3, 2};
  float scores[3], priorities[3] = {1, 3, 2};
  uint8_t mask[3] = {1, 1, 1};
  const sb_tensor n = tensor(counts, SB_INT64, 1, 3, 0, 0), s = tensor(importance, SB_INT64, 1, 3, 0, 0),
                  w = tensor(weighted, SB_FLOAT64, 1, 3, 0, 0), p = floats(scores, 1, 3, 0, 0),
                  l = floats(priorities, 1, 3, 0, 0), m = tensor(mask, SB_UINT8, 1, 3, 0, 0);
  CHECK(sb_importance_scores(TEST_DEVICE, &n, 10, &s) == SB_OK);
  CHECK(importance[0] == 2 && importance[1] == 3 && importance[2] == 3);
  CHECK(sb_pruning_scores(TEST_DEVICE, &w, &p) == SB_OK && scores[0] == 0.0f && scores[1] == 1.0f && scores[2] == 0.5f);
  CHECK(sb_keep_important(TEST_DEVICE, &s, 2.5, &m, &kept) == SB_OK && kept == 2 && mask[0] == 0 && mask[1] == 1);
  memset(mask, 1, 3);
  CHECK(sb_keep_largest(TEST_DEVICE, &l, 1, &m) == SB_OK && mask[0] == 0 && mask[1] == 1 && mask[2] == 0);
  memset(mask, 1, 3);
  CHECK(sb_spare_one(TEST_DEVICE, &l, &m, &kept) == SB_OK && kept == 2 && mask[1] == 0);
  memset(mask, 1, 3);
  CHECK(sb_keep_weighted_sample(TEST_DEVICE, &l, 2, 7, 100, &m) == SB_OK && mask[0] + mask[1] + mask[2] == 2);
}

static void steps_and_measures(void) {
  float values[2] = {1, 1}, gradients[2] = {0.5f, -0.25f}, first[2] = {0, 0}, second[2] = {0, 0};
  const sb_tensor v = floats(values, 1, 2, 0, 0), g = floats(gradients, 1, 2, 0, 0), m = floats(first, 1, 2, 0, 0),
                  s = floats(second, 1, 2, 0, 0);
  const sb_adam_options adam = {0.1f, 0.9f, 0.999f, 1e-15f};
  float points[12] = {0, 0, 0, 1, 0, 0, 3, 0, 0, 7, 0, 0}, distances[4];
  const sb_tensor p = floats(points, 2, 4, 3, 0), d = floats(distances, 1, 4, 0, 0);
  /* 64 points at 1 .. 64 from one camera on a line, of which ten may be wrong */
  float line[192] = {0}, centres[6] = {0, 0, 0, 0, 5, 0}, to_scene[2], clearances[4];
  const sb_tensor cameras = floats(centres, 2, 2, 3, 0), of_cameras = floats(to_scene, 1, 2, 0, 0),
                  clear = floats(clearances, 1, 4, 0, 0), scene = floats(line, 2, 64, 3, 0);
  const sb_step_intervals rest = {16, 32, 64, 15000, 20000};
  int i;
  int32_t steps = -1, iteration = 0;
  double rate = 0;
  CHECK(sb_adam_step(TEST_DEVICE, &v, &g, &m, &s, 1, &adam) == SB_OK);
  CHECK_NEAR(values[0], 0.9, 1e-5); /* the first step is the rate, against the gradient's sign */
  CHECK_NEAR(values[1], 1.1, 1e-5);
  CHECK(gradients[0] == 0.0f && gradients[1] == 0.0f);
  CHECK(sb_mean_squared_neighbor_distances(TEST_DEVICE, &p, 3, &d) == SB_OK);
  CHECK_NEAR(distances[0], (1 + 9 + 49) / 3.0, 1e-5);
  CHECK_NEAR(distances[2], (9 + 4 + 16) / 3.0, 1e-5);
  for (i = 0; i < 64; ++i) line[3 * i] = (float)(i + 1);
  CHECK(sb_distances_to_scene(TEST_DEVICE, &cameras, &scene, &of_cameras) == SB_OK);
  CHECK_NEAR(to_scene[0], 11, 1e-5);
  CHECK_NEAR(to_scene[1], sqrt(121 + 25), 1e-5);
  CHECK(sb_camera_clearances(TEST_DEVICE, &p, &cameras, &of_cameras, &clear) == SB_OK);
  CHECK_NEAR(clearances[1], 1 / 11.0, 1e-6);
  CHECK_NEAR(clearances[3], 7 / 11.0, 1e-6);
  CHECK(sb_steps_at(&rest, 16, 30000, &steps) == SB_OK && steps == 1);
  CHECK(sb_steps_at(&rest, 17, 30000, &steps) == SB_OK && steps == 0);
  CHECK(sb_scaled_iteration(15000, 7000, 30000, &iteration) == SB_OK && iteration == 3500);
  CHECK(sb_exponential_rate(1e-2, 1e-4, 50, 100, &rate) == SB_OK);
  CHECK_NEAR(rate, 1e-3, 1e-9);
}

/* ---- a host with two primitives: all error lies on the first ---- */

typedef struct {
  float color[3 * 100];
  uint8_t truth[3 * 100];
  sb_tensor color_tensor, truth_tensor;
  int64_t rendered;
  int fails;
} Host;

static int32_t host_render(void* context, int64_t view, sb_scored_view* scored) {
  Host* host = context;
  if (host->fails) return 1;
  CHECK(view >= 0 && view < 3);
  ++host->rendered;
  scored->color = &host->color_tensor;
  scored->truth.color = &host->truth_tensor;
  return 0;
}

static int32_t host_count(void* context, const sb_tensor* flagged, const sb_tensor* counts) {
  const uint8_t* flags = flagged->data;
  int32_t* to = counts->data;
  int64_t i;
  (void)context;
  CHECK(flagged->type == SB_UINT8 && flagged->shape[0] == 10 && flagged->shape[1] == 10 && flagged->strides[0] == 10);
  CHECK(counts->type == SB_INT32 && counts->shape[0] == 2);
  for (i = 0; i < 100; ++i) to[i < 50 ? 0 : 1] += flags[i];
  return 0;
}

static void decides_as_the_adapter(void) {
  static Host host;
  sb_adapter* adapter = NULL;
  sb_boost* boost = NULL;
  const char* name = NULL;
  double value = -1;
  int32_t kind = -1;
  float beta = 0, gradients[2] = {1, 1}, absolute[2] = {1, 1}, scales[2] = {1e-6f, 1e-6f}, opacities[2] = {0.9f, 0.05f};
  uint8_t clone[2], split[2], remove[2] = {0, 0};
  int32_t answer = -1;
  const sb_tensor g = floats(gradients, 1, 2, 0, 0), a = floats(absolute, 1, 2, 0, 0), s = floats(scales, 1, 2, 0, 0),
                  o = floats(opacities, 1, 2, 0, 0), c = tensor(clone, SB_UINT8, 1, 2, 0, 0),
                  p = tensor(split, SB_UINT8, 1, 2, 0, 0), r = tensor(remove, SB_UINT8, 1, 2, 0, 0);
  sb_density density;
  sb_views views;
  int i;
  for (i = 0; i < 300; ++i) host.color[i] = i % 100 < 50 && i % 2 == 0 ? 1.0f : 0.0f;
  host.color_tensor = floats(host.color, 3, 3, 10, 10);
  host.truth_tensor = tensor(host.truth, SB_UINT8, 3, 3, 10, 10);
  memset(&density, 0, sizeof density);
  density.iteration = 1000;
  density.total = 30000;
  density.scene_extent = 1;
  density.gradients = &g;
  density.gradients_abs = &a;
  density.max_scales = &s;
  memset(&views, 0, sizeof views);
  views.context = &host;
  views.primitives = 2;
  views.views = 3;
  views.render = host_render;
  views.count_flagged = host_count;

  CHECK(sb_boost_create("vanilla", 0, &boost) == SB_OK);
  CHECK(sb_boost_get(boost, "views", &value) == SB_OK && value == 10);
  CHECK(sb_boost_get(boost, "vcd", &value) == SB_OK && value == 1);
  CHECK(sb_boost_setting(boost, 0, &name, &kind) == SB_OK && strcmp(name, "literal") == 0 && kind == SB_SETTING_BOOL);
  for (i = 0, value = 0; sb_boost_setting(boost, i, &name, &kind) == SB_OK && name != NULL; ++i) {
    CHECK(sb_boost_get(boost, name, &value) == SB_OK && sb_boost_set(boost, name, value) == SB_OK);
    CHECK(strcmp(name, "views") != 0 || kind == SB_SETTING_INTEGER);
    CHECK(strcmp(name, "tau_d") != 0 || kind == SB_SETTING_REAL);
  }
  CHECK(i > 10);
  CHECK(sb_boost_set(boost, "literal", 1) == SB_ERROR_ARGUMENT);
  CHECK(strstr(sb_last_error(), "literal is an argument of sb_boost_create") != NULL);
  CHECK(sb_boost_set(boost, "growth_after_reset", 3000) == SB_OK);
  CHECK(sb_adapter_create(boost, 0, TEST_DEVICE, &adapter) == SB_OK);
  CHECK(sb_adapter_grow(adapter, &density, &views, &c, &p, NULL) == SB_ERROR_ARGUMENT);
  CHECK(strstr(sb_last_error(), "views.add_weights") != NULL && host.rendered == 0);
  sb_adapter_destroy(adapter);
  CHECK(sb_boost_set(boost, "late_share", 0) == SB_OK && sb_boost_set(boost, "replaced_share", 0) == SB_OK);
  CHECK(sb_adapter_create(boost, 0, TEST_DEVICE, &adapter) == SB_OK);
  CHECK(sb_adapter_beta(adapter, &beta) == SB_OK && beta == 0.5f);
  CHECK(sb_adapter_grows_at(adapter, 1000, 30000, 0, &answer) == SB_OK && answer == 1);
  CHECK(sb_adapter_steps_at(adapter, "f_rest", 17, 30000, &answer) == SB_OK && answer == 0);
  CHECK(sb_adapter_steps_at(adapter, "xyz", 17, 30000, &answer) == SB_OK && answer == 1);
  CHECK(sb_adapter_prunes_at(adapter, 18000, 30000, 0, &answer) == SB_OK && answer == 1);
  CHECK(sb_adapter_prunes_large_at(adapter, 4000, 30000, 1, &answer) == SB_OK && answer == 0);
  CHECK(sb_adapter_averages_at(adapter, 30000, 30000, &answer) == SB_OK && answer == 1);
  CHECK(sb_adapter_averages_at(adapter, 15000, 30000, &answer) == SB_OK && answer == 0);
  CHECK(sb_adapter_resets_opacities_at(adapter, 3000, 30000, 1, &answer) == SB_OK && answer == 1);
  CHECK(sb_adapter_resets_opacities_at(adapter, 18000, 30000, 1, &answer) == SB_OK && answer == 0);
  CHECK(sb_adapter_rate_factor(adapter, "xyz", 30000, 30000, &beta) == SB_OK && beta == 1);
  CHECK(sb_adapter_resets_opacities_at(adapter, 4500, 30000, 1, &answer) == SB_OK && answer == 1);
  CHECK(sb_adapter_resets_opacities_at(adapter, 4500, 30000, 0, &answer) == SB_OK && answer == 0);
  CHECK(sb_adapter_resets_opacities_at(adapter, 4501, 30000, 1, &answer) == SB_OK && answer == 0);
  CHECK(sb_adapter_grow(adapter, &density, &views, &c, &p, NULL) == SB_OK);
  CHECK(host.rendered == 3);
  CHECK(clone[0] == 1 && clone[1] == 0 && split[0] == 0 && split[1] == 0);

  { /* within growth: half of the candidates go, the better scored one; the other has weight 0 */
    int32_t origins[2] = {0, 1};
    const sb_tensor from = tensor(origins, SB_INT32, 1, 2, 0, 0);
    memset(remove, 1, 2);
    CHECK(sb_adapter_prune(adapter, &density, &views, &r, &from, NULL) == SB_OK && remove[0] == 1 && remove[1] == 0);
    origins[1] = 2;
    CHECK(sb_adapter_prune(adapter, &density, &views, &r, &from, NULL) == SB_ERROR_ARGUMENT);
  }
  density.opacities = &o;
  { /* neither within growth nor late: the host's candidates as they are */
    const int rendered = host.rendered;
    remove[0] = 0, remove[1] = 1;
    density.iteration = 17000;
    CHECK(sb_adapter_prune(adapter, &density, &views, &r, NULL, NULL) == SB_OK && remove[0] == 0 && remove[1] == 1);
    CHECK(host.rendered == rendered);
    remove[1] = 0;
  }
  density.iteration = 18000;
  CHECK(sb_adapter_prune(adapter, &density, &views, &r, NULL, NULL) == SB_OK && remove[0] == 1 && remove[1] == 1);
  { /* the scores of late pruning do not serve growth, even of the same iteration */
    int32_t origins[2] = {0, 1};
    const sb_tensor from = tensor(origins, SB_INT32, 1, 2, 0, 0);
    CHECK(sb_adapter_grow(adapter, &density, &views, &c, &p, NULL) == SB_OK);
    CHECK(sb_adapter_prune(adapter, &density, &views, &r, NULL, NULL) == SB_OK);
    CHECK(sb_adapter_prune(adapter, &density, &views, &r, &from, NULL) == SB_ERROR_ARGUMENT);
  }

  host.fails = 1;
  CHECK(sb_adapter_grow(adapter, &density, &views, &c, &p, NULL) == SB_ERROR_CALLBACK);
  CHECK(strstr(sb_last_error(), "views.render") != NULL);
  sb_adapter_destroy(adapter);
  sb_adapter_destroy(NULL);

  sb_boost_destroy(boost);

  CHECK(sb_boost_create("vanilla", 1, &boost) == SB_OK);
  CHECK(sb_boost_get(boost, "gradient_abs_threshold", &value) == SB_OK && value == 0.0012);
  CHECK(sb_boost_get(boost, "densify_interval", &value) == SB_OK && value == 500);
  sb_boost_destroy(boost);
  CHECK(sb_boost_create("dropgaussian", 0, &boost) == SB_OK);
  CHECK(sb_boost_get(boost, "schedule", &value) == SB_OK && value == 0);
  sb_boost_destroy(boost);
  CHECK(sb_boost_create("scaffold-gs", 0, &boost) == SB_OK);
  CHECK(sb_adapter_create(boost, 0, TEST_DEVICE, &adapter) == SB_OK);
  CHECK(sb_adapter_rate_factor(adapter, "scaling", 30000, 30000, &beta) == SB_OK && beta < 0.2f);
  sb_adapter_destroy(adapter);
  sb_boost_destroy(boost);
  CHECK(sb_boost_create("mipsplatting", 0, &boost) == SB_ERROR_ARGUMENT && boost == NULL);
  CHECK(strstr(sb_last_error(), "mip-splatting") != NULL);
}

int main(void) {
  CHECK(sb_abi_version() == SB_ABI_VERSION);
  CHECK(strlen(sb_version()) > 0 && sb_last_error() != NULL);
  CHECK(sb_has_device(SB_CPU) == 1 && sb_has_device(77) == 0);
  CHECK(sb_has_device(SB_CUDA) == 0 || strlen(sb_cuda_architectures()) > 0);
  CHECK(sb_has_device(TEST_KIND) == 1);
  renders_and_differentiates();
  draws_convexes();
  tells_what_is_seen();
  measures_errors();
  scores_and_selects();
  steps_and_measures();
  decides_as_the_adapter();
  if (failures == 0) printf("splatboost %s: all well\n", sb_version());
  return failures == 0 ? 0 : 1;
}
