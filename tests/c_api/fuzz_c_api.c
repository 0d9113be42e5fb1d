/* SPDX-License-Identifier: Apache-2.0 */
/* Every entry with wrong arguments: an error code and a message, never a crash. One thing is wrong at a time, where the
 * error is asserted; then several at once, where only the survival is (the sanitizers' build watches). */
#include "checks.h"

#include <c/adapters_c.h>

#include <limits.h>
#include <stdlib.h>

enum { N = 3, W = 20, H = 12, MOST = 10, ROOM = 1 << 16 };
#ifdef SPLATBOOST_TEST_ON_CUDA /* the emulator is slow */
enum { TENSOR_ROUNDS = 100, VALUE_ROUNDS = 300 };
#else
enum { TENSOR_ROUNDS = 300, VALUE_ROUNDS = 2000 };
#endif

/** An entry with valid arguments. Tensors are pointed to, so that they can be changed and left out. */
typedef struct Entry {
  const char* name;
  int tensors;
  sb_tensor t[MOST];
  const sb_tensor* p[MOST];
  int optional[MOST]; /* 1: may be NULL */
  int any_size[MOST]; /* 1: any size of some dimension is as good; growing it is no error */
  sb_status (*call)(const struct Entry* entry);
} Entry;

/* Memory is larger than any shape that passes the checks here. */
static union {
  float f[ROOM];
  double d[ROOM];
  int64_t i64[ROOM];
  int32_t i32[ROOM];
  uint8_t u8[ROOM];
} memory[MOST];

static sb_rasterizer* rasterizer;
static sb_adapter* adapter;
static sb_camera camera;
static sb_raster_options raster_options;
static const sb_adam_options adam_options = {1e-3f, 0.9f, 0.999f, 1e-15f};

static sb_gaussians gaussians_of(const Entry* e) { /* means scales rotations opacities sh_dc sh_rest features */
  sb_gaussians g;
  memset(&g, 0, sizeof g);
  g.means = e->p[0];
  g.scales = e->p[1];
  g.rotations = e->p[2];
  g.opacities = e->p[3];
  g.sh_dc = e->p[4];
  g.sh_rest = e->p[5];
  g.features = e->p[6];
  g.sh_degree = 1;
  return g;
}

static sb_gaussian_gradients gradients_of(const sb_tensor* const p[7]) { /* in the order of gaussians_of */
  sb_gaussian_gradients to;
  memset(&to, 0, sizeof to);
  to.means = p[0];
  to.scales = p[1];
  to.rotations = p[2];
  to.opacities = p[3];
  to.sh_dc = p[4];
  to.sh_rest = p[5];
  to.features = p[6];
  return to;
}

static sb_image_gradients image_gradients_of(const sb_tensor* color, const sb_tensor* features) {
  sb_image_gradients from;
  memset(&from, 0, sizeof from);
  from.color = color;
  from.features = features;
  return from;
}

static sb_raster_outputs outputs_of(const sb_tensor* color, const sb_tensor* features) {
  sb_raster_outputs outputs;
  memset(&outputs, 0, sizeof outputs);
  outputs.color = color;
  outputs.features = features;
  return outputs;
}

/** Draws the Gaussians into an image of its own. */
static sb_status draw(const sb_gaussians* g, const sb_raster_options* options, int with_features) {
  static float image[5 * W * H];
  const sb_tensor color = floats(image, 3, 3, H, W), features = floats(image + 3 * W * H, 3, 2, H, W);
  const sb_raster_outputs outputs = outputs_of(&color, with_features ? &features : NULL);
  return sb_rasterizer_forward(rasterizer, &camera, g, options, &outputs, NULL);
}

static sb_status call_forward_inputs(const Entry* e) {
  const sb_gaussians g = gaussians_of(e);
  return draw(&g, &raster_options, 0);
}

static Entry scene; /* valid inputs of call_forward_inputs */

static sb_status call_forward_outputs(const Entry* e) {
  const sb_gaussians g = gaussians_of(&scene);
  sb_raster_outputs o = outputs_of(e->p[0], e->p[1]);
  o.inverse_depth = e->p[2];
  o.alpha = e->p[3];
  o.radii = e->p[4];
  o.visible = e->p[5];
  return sb_rasterizer_forward(rasterizer, &camera, &g, &raster_options, &o, NULL);
}

static void draw_scene(void) {
  const sb_gaussians g = gaussians_of(&scene);
  CHECK(draw(&g, &raster_options, 1) == SB_OK);
}

static sb_status call_backward_inputs(const Entry* e) {
  const sb_gaussians g = gaussians_of(e);
  const sb_image_gradients from = image_gradients_of(e->p[7], e->p[8]);
  const sb_gaussian_gradients to = {0};
  draw_scene();
  return sb_rasterizer_backward(rasterizer, &g, &from, &to, NULL);
}

static sb_status call_backward_outputs(const Entry* e) {
  const sb_gaussians g = gaussians_of(&scene);
  const sb_image_gradients from = image_gradients_of(NULL, NULL);
  sb_gaussian_gradients to = gradients_of(e->p);
  draw_scene();
  to.screen_means = e->p[7];
  to.screen_means_abs = e->p[8];
  return sb_rasterizer_backward(rasterizer, &g, &from, &to, NULL);
}

static sb_status call_count(const Entry* e) {
  draw_scene();
  return sb_rasterizer_count_flagged(rasterizer, e->p[0], e->p[1], NULL);
}

static sb_convex_rasterizer* convex_rasterizer;
static const sb_convex_options convex_options = {SB_CONVEX_BOX_COMPACT, 0.5f, 0.2f, 1, {0, 0, 0}, 0};

static sb_convexes convexes_of(const Entry* e) { /* points smoothness sharpness opacities sh_dc sh_rest */
  sb_convexes c;
  memset(&c, 0, sizeof c);
  c.points = e->p[0];
  c.smoothness = e->p[1];
  c.sharpness = e->p[2];
  c.opacities = e->p[3];
  c.sh_dc = e->p[4];
  c.sh_rest = e->p[5];
  c.sh_degree = 1;
  return c;
}

static sb_status draw_convexes(const sb_convexes* c) {
  static float image[3 * W * H];
  const sb_tensor color = floats(image, 3, 3, H, W);
  const sb_convex_outputs outputs = {&color, NULL, NULL};
  return sb_convex_rasterizer_forward(convex_rasterizer, &camera, c, &convex_options, &outputs, NULL);
}

static sb_status call_convexes_forward_inputs(const Entry* e) {
  const sb_convexes c = convexes_of(e);
  return draw_convexes(&c);
}

static Entry convex_scene; /* valid inputs of call_convexes_forward_inputs */

static sb_status call_convexes_forward_outputs(const Entry* e) {
  const sb_convexes c = convexes_of(&convex_scene);
  const sb_convex_outputs o = {e->p[0], e->p[1], e->p[2]};
  return sb_convex_rasterizer_forward(convex_rasterizer, &camera, &c, &convex_options, &o, NULL);
}

static sb_status call_convexes_backward_inputs(const Entry* e) {
  const sb_convexes c = convexes_of(e), drawn = convexes_of(&convex_scene);
  const sb_convex_gradients to = {0};
  CHECK(draw_convexes(&drawn) == SB_OK);
  return sb_convex_rasterizer_backward(convex_rasterizer, &c, e->p[6], e->p[7], &to, NULL);
}

static sb_status call_convexes_backward_outputs(const Entry* e) {
  const sb_convexes c = convexes_of(&convex_scene);
  sb_convex_gradients to;
  memset(&to, 0, sizeof to);
  to.points = e->p[0];
  to.smoothness = e->p[1];
  to.sharpness = e->p[2];
  to.opacities = e->p[3];
  to.sh_dc = e->p[4];
  to.sh_rest = e->p[5];
  to.sharpness_abs = e->p[6];
  to.screen_points = e->p[7];
  CHECK(draw_convexes(&c) == SB_OK);
  return sb_convex_rasterizer_backward(convex_rasterizer, &c, NULL, NULL, &to, NULL);
}

static sb_status call_convexes_count(const Entry* e) {
  const sb_convexes c = convexes_of(&convex_scene);
  CHECK(draw_convexes(&c) == SB_OK);
  return sb_convex_rasterizer_count_flagged(convex_rasterizer, e->p[0], e->p[1], NULL);
}

static sb_status call_convexes_weights(const Entry* e) {
  const sb_convexes c = convexes_of(&convex_scene);
  CHECK(draw_convexes(&c) == SB_OK);
  return sb_convex_rasterizer_add_weights(convex_rasterizer, e->p[0], NULL);
}

static sb_status call_observed(const Entry* e) {
  draw_scene();
  return sb_rasterizer_count_observed(rasterizer, 0.5f, e->p[0], NULL);
}

static sb_status call_weights(const Entry* e) {
  draw_scene();
  return sb_rasterizer_add_weights(rasterizer, e->p[0], NULL);
}

static sb_status call_mark_visible(const Entry* e) {
  return sb_mark_visible(TEST_DEVICE, &camera, e->p[0], 0.2f, e->p[1]);
}

static sb_status call_visible_radii(const Entry* e) {
  sb_gaussians g;
  memset(&g, 0, sizeof g);
  g.means = e->p[0];
  g.covariances = e->p[1];
  return sb_visible_radii(TEST_DEVICE, &camera, &g, &raster_options, e->p[2]);
}

static sb_status call_flag_errors(const Entry* e) {
  sb_truth truth;
  truth.color = e->p[1];
  truth.valid = e->p[2];
  return sb_flag_errors(TEST_DEVICE, e->p[0], &truth, 0.1f, e->p[3], e->p[4], NULL);
}

static sb_status call_photometric(const Entry* e) {
  sb_truth truth;
  sb_loss loss;
  truth.color = e->p[1];
  truth.valid = e->p[2];
  return sb_photometric_loss(TEST_DEVICE, e->p[0], &truth, 0.2f, e->p[3], &loss);
}

static sb_status call_ssim(const Entry* e) { return sb_ssim(TEST_DEVICE, e->p[0], e->p[1], 1, e->p[2], e->p[3]); }

static sb_status call_importance(const Entry* e) { return sb_importance_scores(TEST_DEVICE, e->p[0], 10, e->p[1]); }
static sb_status call_pruning(const Entry* e) { return sb_pruning_scores(TEST_DEVICE, e->p[0], e->p[1]); }
static sb_status call_keep_important(const Entry* e) {
  return sb_keep_important(TEST_DEVICE, e->p[0], 5, e->p[1], NULL);
}
static sb_status call_keep_sample(const Entry* e) {
  return sb_keep_weighted_sample(TEST_DEVICE, e->p[0], 1, 0, 0, e->p[1]);
}
static sb_status call_keep_largest(const Entry* e) { return sb_keep_largest(TEST_DEVICE, e->p[0], 1, e->p[1]); }
static sb_status call_spare_one(const Entry* e) { return sb_spare_one(TEST_DEVICE, e->p[0], e->p[1], NULL); }
static sb_status call_adam(const Entry* e) {
  return sb_adam_step(TEST_DEVICE, e->p[0], e->p[1], e->p[2], e->p[3], 1, &adam_options);
}
static sb_status call_neighbors(const Entry* e) {
  return sb_mean_squared_neighbor_distances(TEST_DEVICE, e->p[0], 3, e->p[1]);
}

static sb_status call_distances(const Entry* e) {
  return sb_distances_to_scene(TEST_DEVICE, e->p[0], e->p[1], e->p[2]);
}
static sb_status call_clearances(const Entry* e) {
  return sb_camera_clearances(TEST_DEVICE, e->p[0], e->p[1], e->p[2], e->p[3]);
}

/* The host's answer is fuzzed as well. */
static const Entry* host_entry;
static int32_t host_render(void* context, int64_t view, sb_scored_view* scored) {
  (void)context;
  (void)view;
  scored->color = host_entry->p[5];
  scored->truth.color = host_entry->p[6];
  scored->truth.valid = host_entry->p[7];
  return 0;
}
static int32_t host_count(void* context, const sb_tensor* flagged, const sb_tensor* counts) {
  (void)context;
  (void)flagged;
  ((int32_t*)counts->data)[0] += 1;
  return 0;
}
static int32_t host_weigh(void* context, const sb_tensor* weights) {
  (void)context;
  (void)weights;
  return 0;
}
static sb_views host_views(void) {
  sb_views v;
  memset(&v, 0, sizeof v);
  v.primitives = N;
  v.views = 2;
  v.render = host_render;
  v.count_flagged = host_count;
  v.add_weights = host_weigh;
  return v;
}
static sb_density host_density(const Entry* e) {
  sb_density d;
  memset(&d, 0, sizeof d);
  d.iteration = 600;
  d.total = 30000;
  d.scene_extent = 1;
  d.gradients = e->p[0];
  d.gradients_abs = e->p[1];
  d.max_scales = e->p[2];
  return d;
}
static sb_status call_grow(const Entry* e) {
  const sb_density d = host_density(e);
  const sb_views v = host_views();
  host_entry = e;
  return sb_adapter_grow(adapter, &d, &v, e->p[3], e->p[4], NULL);
}
static Entry grow_entry;
static sb_status call_prune(const Entry* e) {
  sb_density d = host_density(&grow_entry);
  const sb_views v = host_views();
  Entry host = grow_entry;
  host.p[5] = e->p[2];
  host.p[6] = e->p[3];
  host_entry = &host;
  d.iteration = 18000; /* of late pruning; at others it looks at nothing */
  d.opacities = e->p[1];
  return sb_adapter_prune(adapter, &d, &v, e->p[0], NULL, NULL);
}
static sb_status call_prune_grown(const Entry* e) {
  const sb_density d = host_density(&grow_entry);
  const sb_views v = host_views();
  CHECK(call_grow(&grow_entry) == SB_OK);
  return sb_adapter_prune(adapter, &d, &v, e->p[0], e->p[1], NULL);
}

/* ---- the entries with valid arguments ---- */

static void add(Entry* e, int32_t type, int32_t dimensions, int64_t a, int64_t b, int64_t c, int optional,
                int any_size) {
  const int i = e->tensors++;
  e->t[i] = tensor(memory[i].f, type, dimensions, a, b, c);
  e->optional[i] = optional;
  e->any_size[i] = any_size;
  e->p[i] = &e->t[i];
}

static Entry entry(const char* name, sb_status (*call)(const Entry*)) {
  Entry e;
  memset(&e, 0, sizeof e);
  e.name = name;
  e.call = call;
  return e;
}

/** Pointers of a copied entry are to its own tensors. */
static void repoint(Entry* e) {
  int i;
  for (i = 0; i < e->tensors; ++i) e->p[i] = &e->t[i];
}

static void add_gaussians(Entry* e) {
  add(e, SB_FLOAT32, 2, N, 3, 0, 0, 0);
  add(e, SB_FLOAT32, 2, N, 3, 0, 0, 0);
  add(e, SB_FLOAT32, 2, N, 4, 0, 0, 0);
  add(e, SB_FLOAT32, 2, N, 1, 0, 0, 0);
  add(e, SB_FLOAT32, 3, N, 1, 3, 0, 0);
  add(e, SB_FLOAT32, 3, N, 3, 3, 0, 1);
  add(e, SB_FLOAT32, 2, N, 2, 0, 1, 1);
}

static void add_convexes(Entry* e) {
  add(e, SB_FLOAT32, 3, N, 6, 3, 0, 0);
  add(e, SB_FLOAT32, 2, N, 1, 0, 0, 0);
  add(e, SB_FLOAT32, 1, N, 0, 0, 0, 0);
  add(e, SB_FLOAT32, 2, N, 1, 0, 0, 0);
  add(e, SB_FLOAT32, 3, N, 1, 3, 0, 0);
  add(e, SB_FLOAT32, 3, N, 3, 3, 0, 1);
}

/** What a call with the scene writes must not lie where the scene does. */
static void move_from_scene(Entry* e) {
  int i;
  for (i = 0; i < e->tensors; ++i) e->t[i].data = (char*)e->t[i].data + sizeof(float) * 8192;
}

static void fill_memory(void) {
  int i, j;
  for (i = 0; i < MOST; ++i) {
    memset(&memory[i], 0, sizeof memory[i]);
    for (j = 0; j < 4096; ++j) memory[i].f[j] = 0.5f + (float)(j % 7) * 0.1f;
  }
}

static int make_entries(Entry* e) {
  int n = 0, i;
  e[n] = entry("sb_rasterizer_forward, inputs", call_forward_inputs);
  add_gaussians(&e[n]);
  scene = e[n];
  repoint(&scene);
  ++n;
  e[n] = entry("sb_rasterizer_forward, outputs", call_forward_outputs);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 1, 0);
  add(&e[n], SB_FLOAT32, 3, 2, H, W, 1, 0);
  add(&e[n], SB_FLOAT32, 3, 1, H, W, 1, 0);
  add(&e[n], SB_FLOAT32, 3, 1, H, W, 1, 0);
  add(&e[n], SB_INT32, 1, N, 0, 0, 1, 0);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 1, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_rasterizer_backward, inputs", call_backward_inputs);
  add_gaussians(&e[n]);
  e[n].any_size[5] = e[n].any_size[6] = e[n].optional[6] = 0; /* those of the forward pass */
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 1, 0);
  add(&e[n], SB_FLOAT32, 3, 2, H, W, 1, 0);
  ++n;
  e[n] = entry("sb_rasterizer_backward, outputs", call_backward_outputs);
  add_gaussians(&e[n]);
  for (i = 0; i < 7; ++i) {
    e[n].optional[i] = 1;
    e[n].any_size[i] = 0;
  }
  add(&e[n], SB_FLOAT32, 2, N, 2, 0, 1, 0);
  add(&e[n], SB_FLOAT32, 2, N, 2, 0, 1, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_rasterizer_count_flagged", call_count);
  add(&e[n], SB_UINT8, 2, H, W, 0, 0, 0);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_convex_rasterizer_forward, inputs", call_convexes_forward_inputs);
  add_convexes(&e[n]);
  convex_scene = e[n];
  repoint(&convex_scene);
  ++n;
  e[n] = entry("sb_convex_rasterizer_forward, outputs", call_convexes_forward_outputs);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 0, 0);
  add(&e[n], SB_FLOAT32, 3, 1, H, W, 1, 0);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 1, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_convex_rasterizer_backward, inputs", call_convexes_backward_inputs);
  add_convexes(&e[n]);
  e[n].any_size[5] = 0; /* that of the forward pass */
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 1, 0);
  add(&e[n], SB_FLOAT32, 2, H, W, 0, 1, 0);
  ++n;
  e[n] = entry("sb_convex_rasterizer_backward, outputs", call_convexes_backward_outputs);
  add_convexes(&e[n]);
  add(&e[n], SB_FLOAT32, 1, N, 0, 0, 1, 0);
  add(&e[n], SB_FLOAT32, 2, N, 3, 0, 1, 0);
  for (i = 0; i < 6; ++i) {
    e[n].optional[i] = 1;
    e[n].any_size[i] = 0;
  }
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_convex_rasterizer_count_flagged", call_convexes_count);
  add(&e[n], SB_UINT8, 2, H, W, 0, 0, 0);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_convex_rasterizer_add_weights", call_convexes_weights);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_rasterizer_count_observed", call_observed);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_rasterizer_add_weights", call_weights);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  move_from_scene(&e[n]);
  ++n;
  e[n] = entry("sb_mark_visible", call_mark_visible);
  add(&e[n], SB_FLOAT32, 2, N, 3, 0, 0, 0);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_visible_radii", call_visible_radii);
  add(&e[n], SB_FLOAT32, 2, N, 3, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 2, N, 6, 0, 0, 0);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_flag_errors", call_flag_errors);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 2, H, W, 0, 1, 0);
  add(&e[n], SB_FLOAT32, 2, H, W, 0, 0, 0);
  add(&e[n], SB_UINT8, 2, H, W, 0, 0, 0);
  ++n;
  e[n] = entry("sb_photometric_loss", call_photometric);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 2, H, W, 0, 1, 0);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 1, 0);
  ++n;
  e[n] = entry("sb_ssim", call_ssim);
  for (i = 0; i < 3; ++i) {
    add(&e[n], SB_FLOAT32, 3, 3, H, W, i == 2, 0);
    e[n].t[i].dimensions = 4;
    e[n].t[i].shape[3] = W;
    e[n].t[i].shape[2] = H;
    e[n].t[i].shape[1] = 3;
    e[n].t[i].shape[0] = 1;
    e[n].t[i].strides[3] = 1;
    e[n].t[i].strides[2] = W;
    e[n].t[i].strides[1] = W * H;
    e[n].t[i].strides[0] = 3 * W * H;
  }
  add(&e[n], SB_FLOAT64, 1, 1, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_importance_scores", call_importance);
  add(&e[n], SB_INT64, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_INT64, 1, N, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_pruning_scores", call_pruning);
  add(&e[n], SB_FLOAT64, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_keep_important", call_keep_important);
  add(&e[n], SB_INT64, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
  ++n;
  for (i = 0; i < 3; ++i) {
    const char* const names[3] = {"sb_keep_weighted_sample", "sb_keep_largest", "sb_spare_one"};
    sb_status (*const calls[3])(const Entry*) = {call_keep_sample, call_keep_largest, call_spare_one};
    e[n] = entry(names[i], calls[i]);
    add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
    add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
    ++n;
  }
  e[n] = entry("sb_adam_step", call_adam);
  for (i = 0; i < 4; ++i) add(&e[n], SB_FLOAT32, 2, N, 3, 0, 0, 0);
  ++n;
  e[n] = entry("sb_mean_squared_neighbor_distances", call_neighbors);
  add(&e[n], SB_FLOAT32, 2, N, 3, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_distances_to_scene", call_distances);
  for (i = 0; i < 2; ++i) add(&e[n], SB_FLOAT32, 2, N, 3, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
  e[n].any_size[1] = 1;
  ++n;
  e[n] = entry("sb_camera_clearances", call_clearances);
  for (i = 0; i < 2; ++i) add(&e[n], SB_FLOAT32, 2, N, 3, 0, 0, 0);
  for (i = 0; i < 2; ++i) add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
  ++n;
  e[n] = entry("sb_adapter_grow", call_grow);
  for (i = 0; i < 3; ++i) add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 2, H, W, 0, 1, 0);
  grow_entry = e[n];
  repoint(&grow_entry);
  ++n;
  e[n] = entry("sb_adapter_prune, late", call_prune);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_FLOAT32, 3, 3, H, W, 0, 0);
  add(&e[n], SB_UINT8, 3, 3, H, W, 0, 0);
  ++n;
  e[n] = entry("sb_adapter_prune, within growth", call_prune_grown);
  add(&e[n], SB_UINT8, 1, N, 0, 0, 0, 0);
  add(&e[n], SB_INT32, 1, N, 0, 0, 0, 0);
  e[n].t[1].data = memory[9].i32 + 4096; /* zeros: valid origins */
  e[n].optional[1] = 1;                  /* without: as not within growth, where nothing changes now */
  ++n;
  for (i = 0; i < n; ++i) repoint(&e[i]);
  return n;
}

/* ---- one thing wrong at a time ---- */

enum {
  NULL_TENSOR,
  NULL_DATA,
  OTHER_TYPE,
  NO_TYPE,
  NEGATIVE_DIMENSIONS,
  TOO_MANY_DIMENSIONS,
  NO_DIMENSIONS,
  NEGATIVE_SIZE,
  HUGE_SIZE,
  OVERFLOWING_SIZE,
  GROWN,
  ZERO_STRIDE,
  NEGATIVE_STRIDE,
  WIDE_STRIDE,
  ON_OTHER,
  ON_NOTHING,
  OTHER_INDEX,
  MISALIGNED,
  MUTATIONS
};

/** @return whether an error must follow */
static int mutate(Entry* e, int i, int mutation) {
  sb_tensor* const t = &e->t[i];
  const int known = t->dimensions > 0 && t->dimensions <= SB_MAX_DIMENSIONS; /* not mutated before */
  const int last = known ? t->dimensions - 1 : 0;
  switch (mutation) {
    case NULL_TENSOR:
      e->p[i] = NULL;
      return !e->optional[i];
    case NULL_DATA:
      t->data = NULL;
      return 1;
    case OTHER_TYPE:
      t->type = t->type == SB_FLOAT32 ? SB_FLOAT64 : SB_FLOAT32;
      return 1;
    case NO_TYPE:
      t->type = 99;
      return 1;
    case NEGATIVE_DIMENSIONS:
      t->dimensions = INT32_MIN;
      return 1;
    case TOO_MANY_DIMENSIONS:
      t->dimensions = INT32_MAX;
      return 1;
    case NO_DIMENSIONS:
      t->dimensions = 0;
      return 1;
    case NEGATIVE_SIZE:
      t->shape[0] = -t->shape[0];
      return 1;
    case HUGE_SIZE:
      t->shape[0] = INT64_MAX;
      return 1;
    case OVERFLOWING_SIZE:
      t->shape[0] = (int64_t)1 << 62;
      return 1;
    case GROWN:
      t->shape[last > 0 && e->any_size[i] ? 1 : 0] += 1;
      return !e->any_size[i];
    case ZERO_STRIDE:
      t->strides[last > 0 ? last - 1 : 0] = 0;
      return t->shape[last > 0 ? last - 1 : 0] != 1; /* the stride of a single element is not used */
    case NEGATIVE_STRIDE:
      t->strides[last] = -1;
      return t->shape[last] != 1;
    case WIDE_STRIDE:
      t->strides[0] *= 2;
      return t->shape[0] != 1;
    case ON_OTHER:
      t->device_kind = OTHER_KIND;
      return 1;
    case ON_NOTHING:
      t->device_kind = 12345;
      return 1;
    case OTHER_INDEX:
      t->device_index = 1;
      return 1;
    default:
      if (t->type == SB_UINT8) return 0;
      t->data = (char*)t->data + 1;
      return 1;
  }
}

/** Whether an entry said no, and why. */
static int refused(sb_status status) {
  return status != SB_OK && status != SB_ERROR_INTERNAL && strlen(sb_last_error()) > 0;
}

static uint32_t state = 12345;
static uint32_t next_random(void) {
  state = state * 1664525u + 1013904223u;
  return state >> 8;
}

static void fuzz_tensors(void) {
  static Entry entries[32];
  const int n = make_entries(entries);
  int k, i, mutation, round;
  for (k = 0; k < n; ++k) {
    fill_memory();
    if (entries[k].call(&entries[k]) != SB_OK) {
      ++failures;
      printf("%s: refused though nothing is wrong: %s\n", entries[k].name, sb_last_error());
      continue;
    }
    for (i = 0; i < entries[k].tensors; ++i) {
      for (mutation = 0; mutation < MUTATIONS; ++mutation) {
        Entry e = entries[k];
        int must_fail;
        sb_status status;
        repoint(&e);
        must_fail = mutate(&e, i, mutation);
        fill_memory();
        status = e.call(&e);
        if (must_fail && !refused(status)) {
          ++failures;
          printf("%s: tensor %d, mutation %d: status %d, %s\n", e.name, i, mutation, status, sb_last_error());
        }
      }
    }
    for (round = 0; round < TENSOR_ROUNDS; ++round) {
      Entry e = entries[k];
      const int changes = 2 + (int)(next_random() % 3);
      repoint(&e);
      for (i = 0; i < changes; ++i) {
        mutation = (int)(next_random() % MUTATIONS);
        /* Two tensors of one size that no memory has would be believed: the shape is all there is to see. */
        if (mutation == HUGE_SIZE || mutation == OVERFLOWING_SIZE) continue;
        (void)mutate(&e, (int)(next_random() % (uint32_t)e.tensors), mutation);
      }
      fill_memory();
      (void)e.call(&e);
    }
  }
  printf("%d entries with tensors\n", n);
}

/* ---- handles, structs and numbers ---- */

#define REFUSED(call)                                                                            \
  do {                                                                                           \
    const sb_status status_ = (call);                                                            \
    if (!refused(status_)) {                                                                     \
      ++failures;                                                                                \
      printf("%s:%d: %s: status %d, %s\n", __FILE__, __LINE__, #call, status_, sb_last_error()); \
    }                                                                                            \
  } while (0)

static void fuzz_devices(void) {
  sb_rasterizer* r = NULL;
  sb_adapter* a = NULL;
  sb_boost* boost = NULL;
  sb_device d;
  memset(&d, 0, sizeof d);
  REFUSED(sb_rasterizer_create(&d, NULL));
  d.kind = 5;
  REFUSED(sb_rasterizer_create(&d, &r));
  d.kind = SB_CPU;
  d.threads = -1;
  REFUSED(sb_rasterizer_create(&d, &r));
  d.threads = INT32_MAX;
  REFUSED(sb_rasterizer_create(&d, &r));
  d.threads = 1;
  d.index = 3;
  REFUSED(sb_rasterizer_create(&d, &r));
  d.index = 0;
  d.stream = &d;
  REFUSED(sb_rasterizer_create(&d, &r));
  d.stream = NULL;
  if (!sb_has_device(SB_CUDA)) {
    d.kind = SB_CUDA;
    CHECK(sb_rasterizer_create(&d, &r) == SB_ERROR_NO_CUDA && strstr(sb_last_error(), "CUDA") != NULL);
    d.kind = SB_CPU;
  }
#ifdef SPLATBOOST_TEST_ON_CUDA
  d.kind = SB_CUDA;
  d.index = -1;
  REFUSED(sb_rasterizer_create(&d, &r));
  REFUSED(sb_importance_scores(&d, NULL, 1, NULL));
  d.index = 7;
  CHECK(sb_rasterizer_create(&d, &r) == SB_ERROR_NO_CUDA && strstr(sb_last_error(), "no CUDA device 7") != NULL);
  CHECK(sb_importance_scores(&d, NULL, 1, NULL) == SB_ERROR_NO_CUDA);
  d.index = 0;
#endif
  CHECK(r == NULL);
  CHECK(sb_rasterizer_create(&d, &r) == SB_OK);
  REFUSED(sb_rasterizer_counts(r, NULL, NULL, NULL)); /* nothing drawn yet */
  REFUSED(sb_rasterizer_settle(r, NULL, NULL));
  REFUSED(sb_rasterizer_settle(NULL, NULL, NULL));
  CHECK(sb_cuda_activity(NULL, NULL) == SB_OK);
  {
    const sb_gaussians g = gaussians_of(&scene);
    const sb_image_gradients from = image_gradients_of(NULL, NULL);
    const sb_gaussian_gradients to = {0};
    REFUSED(sb_rasterizer_backward(r, &g, &from, &to, NULL));
    REFUSED(sb_rasterizer_backward(NULL, &g, &from, &to, NULL));
    REFUSED(sb_rasterizer_backward(r, NULL, &from, &to, NULL));
    REFUSED(sb_rasterizer_backward(r, &g, NULL, &to, NULL));
    REFUSED(sb_rasterizer_backward(r, &g, &from, NULL, NULL));
#ifndef SPLATBOOST_TEST_ON_CUDA /* which any stream fits */
    REFUSED(sb_rasterizer_backward(r, &g, &from, &to, &d));
#endif
  }
  sb_rasterizer_destroy(r);
  REFUSED(sb_rasterizer_counts(NULL, NULL, NULL, NULL));
  REFUSED(sb_raster_options_default(NULL));

  REFUSED(sb_boost_create(NULL, 0, &boost));
  REFUSED(sb_boost_create("", 0, &boost));
  REFUSED(sb_boost_create("vanilla", 2, &boost));
  REFUSED(sb_boost_create("x", 0, &boost));
  REFUSED(sb_boost_create("vanilla", 0, NULL));
  CHECK(boost == NULL);
  CHECK(sb_boost_create("mip-splatting", 0, &boost) == SB_OK);
  REFUSED(sb_adapter_create(NULL, 0, NULL, &a));
  REFUSED(sb_adapter_create(boost, 0, NULL, NULL));
  {
    const char* name = NULL;
    double value = 0;
    REFUSED(sb_boost_setting(NULL, 0, &name, NULL));
    REFUSED(sb_boost_setting(boost, 0, NULL, NULL));
    REFUSED(sb_boost_setting(boost, -1, &name, NULL));
    CHECK(sb_boost_setting(boost, INT32_MAX, &name, NULL) == SB_OK && name == NULL);
    REFUSED(sb_boost_get(NULL, "beta", &value));
    REFUSED(sb_boost_get(boost, NULL, &value));
    REFUSED(sb_boost_get(boost, "bet", &value));
    REFUSED(sb_boost_get(boost, "beta", NULL));
    REFUSED(sb_boost_set(NULL, "beta", 0.5));
    REFUSED(sb_boost_set(boost, NULL, 0.5));
    REFUSED(sb_boost_set(boost, "seed", 1));
    REFUSED(sb_boost_set(boost, "vcd", 2));
    REFUSED(sb_boost_set(boost, "views", 2.5));
    REFUSED(sb_boost_set(boost, "views", 1e10));
    REFUSED(sb_boost_set(boost, "beta", NAN));
    REFUSED(sb_boost_set(boost, "tau_d", INFINITY));
  }
#define BROKEN_BOOST(name, value)                      \
  do {                                                 \
    double kept_ = 0;                                  \
    CHECK(sb_boost_get(boost, name, &kept_) == SB_OK); \
    CHECK(sb_boost_set(boost, name, value) == SB_OK);  \
    REFUSED(sb_adapter_create(boost, 0, NULL, &a));    \
    CHECK(sb_boost_set(boost, name, kept_) == SB_OK);  \
  } while (0)
  BROKEN_BOOST("beta", 0);
  BROKEN_BOOST("beta", 1.5);
  BROKEN_BOOST("views", 0);
  BROKEN_BOOST("tau", -1);
  BROKEN_BOOST("lambda_dssim", 2);
  BROKEN_BOOST("tau_d", -1);
  BROKEN_BOOST("gradient_threshold", -1);
  BROKEN_BOOST("densify_from", -1);
  BROKEN_BOOST("densify_interval", 0);
  BROKEN_BOOST("growth_after_reset", -1);
  BROKEN_BOOST("late_prune_from", INT32_MIN);
  BROKEN_BOOST("late_prune_interval", 0);
  BROKEN_BOOST("late_min_opacity", 2);
  CHECK(sb_adapter_create(boost, 0, NULL, &a) == SB_OK);
  sb_adapter_destroy(a);
  a = NULL;
  sb_boost_destroy(boost);
  sb_boost_destroy(NULL);
  CHECK(a == NULL);
}

static void fuzz_structs(void) {
  static float image[3 * W * H];
  const sb_tensor color = floats(image, 3, 3, H, W);
  const sb_gaussians g = gaussians_of(&scene);
  const sb_raster_outputs outputs = outputs_of(&color, NULL);
  REFUSED(sb_rasterizer_forward(NULL, &camera, &g, &raster_options, &outputs, NULL));
  REFUSED(sb_rasterizer_forward(rasterizer, NULL, &g, &raster_options, &outputs, NULL));
  REFUSED(sb_rasterizer_forward(rasterizer, &camera, NULL, &raster_options, &outputs, NULL));
  REFUSED(sb_rasterizer_forward(rasterizer, &camera, &g, NULL, &outputs, NULL));
  REFUSED(sb_rasterizer_forward(rasterizer, &camera, &g, &raster_options, NULL, NULL));
#ifndef SPLATBOOST_TEST_ON_CUDA
  REFUSED(sb_rasterizer_forward(rasterizer, &camera, &g, &raster_options, &outputs, (void*)&color));
#endif
#define BROKEN_CAMERA(field, value)                                                      \
  do {                                                                                   \
    sb_camera c = camera;                                                                \
    c.field = value;                                                                     \
    REFUSED(sb_rasterizer_forward(rasterizer, &c, &g, &raster_options, &outputs, NULL)); \
  } while (0)
  BROKEN_CAMERA(width, 0);
  BROKEN_CAMERA(width, -W);
  BROKEN_CAMERA(width, W + 1);
  BROKEN_CAMERA(width, INT32_MAX);
  BROKEN_CAMERA(height, INT32_MIN);
  BROKEN_CAMERA(fx, 0.0f);
  BROKEN_CAMERA(fx, NAN);
  BROKEN_CAMERA(fy, -1.0f);
  BROKEN_CAMERA(cx, INFINITY);
  BROKEN_CAMERA(camera_from_world[3], NAN);
#define BROKEN_OPTION(field, value)                                              \
  do {                                                                           \
    sb_raster_options o = raster_options;                                        \
    o.field = value;                                                             \
    REFUSED(sb_rasterizer_forward(rasterizer, &camera, &g, &o, &outputs, NULL)); \
  } while (0)
  BROKEN_OPTION(box, 2);
  BROKEN_OPTION(box, INT32_MIN);
  BROKEN_OPTION(beta, 0.0f);
  BROKEN_OPTION(beta, NAN);
  BROKEN_OPTION(low_pass, -0.1f);
  BROKEN_OPTION(low_pass, INFINITY);
  BROKEN_OPTION(near_plane, 0.0f);
  BROKEN_OPTION(near_plane, NAN);
#define BROKEN_GAUSSIANS(field, value)                                                        \
  do {                                                                                        \
    sb_gaussians b = g;                                                                       \
    b.field = value;                                                                          \
    REFUSED(sb_rasterizer_forward(rasterizer, &camera, &b, &raster_options, &outputs, NULL)); \
  } while (0)
  BROKEN_GAUSSIANS(sh_degree, -1);
  BROKEN_GAUSSIANS(sh_degree, 2);
  BROKEN_GAUSSIANS(sh_degree, INT32_MAX);
  BROKEN_GAUSSIANS(colors, g.means);
  BROKEN_GAUSSIANS(covariances, g.means);

  { /* a forward pass that fails leaves nothing to go back to */
    const sb_image_gradients from = image_gradients_of(NULL, NULL);
    const sb_gaussian_gradients to = {0};
    sb_camera wide = camera;
    static float wide_image[3 << 20];
    const sb_tensor wide_color = floats(wide_image, 3, 3, 1, 1 << 20);
    const sb_raster_outputs wide_outputs = outputs_of(&wide_color, NULL);
    wide.width = 1 << 20;
    wide.height = 1;
    draw_scene();
    REFUSED(sb_rasterizer_forward(rasterizer, &wide, &g, &raster_options, &wide_outputs, NULL));
    REFUSED(sb_rasterizer_backward(rasterizer, &g, &from, &to, NULL));
  }
}

/** Gaussians that are no numbers, or too large for any: drawn or not, nothing breaks. */
/** What is no tensor: options, numbers of points, handles. */
static void refuses_convexes(void) {
  static float image[3 * W * H];
  const sb_tensor color = floats(image, 3, 3, H, W);
  const sb_convex_outputs outputs = {&color, NULL, NULL};
  const sb_convex_gradients to = {0};
  sb_convexes c = convexes_of(&convex_scene);
  sb_convex_rasterizer* r = NULL;
  sb_convex_options o;
  int i;
  fill_memory();
  REFUSED(sb_convex_rasterizer_create(TEST_DEVICE, NULL));
  CHECK(sb_convex_rasterizer_create(TEST_DEVICE, &r) == SB_OK);
  REFUSED(sb_convex_rasterizer_backward(r, &c, NULL, NULL, &to, NULL)); /* nothing drawn yet */
  REFUSED(sb_convex_rasterizer_forward(NULL, &camera, &c, &convex_options, &outputs, NULL));
  REFUSED(sb_convex_rasterizer_forward(r, NULL, &c, &convex_options, &outputs, NULL));
  REFUSED(sb_convex_rasterizer_forward(r, &camera, NULL, &convex_options, &outputs, NULL));
  REFUSED(sb_convex_rasterizer_forward(r, &camera, &c, NULL, &outputs, NULL));
  REFUSED(sb_convex_rasterizer_forward(r, &camera, &c, &convex_options, NULL, NULL));
  for (i = 0; i < 7; ++i) {
    o = convex_options;
    if (i == 0) o.box = 2;
    if (i == 1) o.beta = 0;
    if (i == 2) o.beta = NAN;
    if (i == 3) o.near_plane = -1;
    if (i == 4) o.pixel_size = 0;
    if (i == 5) o.pixel_size = INFINITY;
    if (i == 6) c.sh_degree = 2;
    REFUSED(sb_convex_rasterizer_forward(r, &camera, &c, &o, &outputs, NULL));
  }
  c.sh_degree = 1;
  for (i = 1; i < 12; ++i) { /* points a convex */
    sb_tensor points = floats(memory[0].f, 3, N, i, 3);
    c.points = &points;
    if (i >= 3 && i <= 8) {
      CHECK(sb_convex_rasterizer_forward(r, &camera, &c, &convex_options, &outputs, NULL) == SB_OK);
    } else {
      REFUSED(sb_convex_rasterizer_forward(r, &camera, &c, &convex_options, &outputs, NULL));
    }
  }
  sb_convex_rasterizer_destroy(r);
  sb_convex_rasterizer_destroy(NULL);
}

static void fuzz_values(void) {
  const float odd[] = {NAN, INFINITY, -INFINITY, 0.0f, -0.0f, -1.0f, 3e38f, -3e38f, 1e-38f, 1e-45f, 1e9f, 1e20f, 0.2f};
  static float ones[3 * W * H], gradients[MOST][256];
  const sb_tensor g_color = floats(ones, 3, 3, H, W);
  const sb_image_gradients from = image_gradients_of(&g_color, NULL);
  sb_gaussian_gradients to;
  const sb_tensor* p[7];
  sb_tensor t[7];
  int round, i;
  for (i = 0; i < 3 * W * H; ++i) ones[i] = 1;
  for (i = 0; i < 7; ++i) {
    t[i] = scene.t[i];
    t[i].data = gradients[i];
    p[i] = &t[i];
  }
  to = gradients_of(p);
  for (round = 0; round < VALUE_ROUNDS; ++round) {
    sb_raster_options options = raster_options;
    const sb_gaussians g = gaussians_of(&scene);
    fill_memory();
    for (i = 0; i < 4; ++i) {
      memory[next_random() % 7].f[next_random() % (3 * N)] = odd[next_random() % (sizeof odd / sizeof odd[0])];
    }
    options.box = round % 2;
    options.compensate_opacity = round / 2 % 2;
    CHECK(draw(&g, &options, 0) == SB_OK);
    CHECK(sb_rasterizer_backward(rasterizer, &g, &from, &to, NULL) == SB_OK);
  }
  fill_memory();
}

static void fuzz_numbers(void) {
  const sb_tensor* const f = &scene.t[3]; /* float [N,1] */
  sb_tensor row = *f, mask, counts, distances;
  sb_step_intervals intervals = {1, 2, 3, 15000, 20000};
  sb_adam_options adam = adam_options;
  int32_t i32 = 0;
  double d = 0;
  float beta = 0;
  row.dimensions = 1;
  row.strides[0] = 1;
  distances = row;
  mask = tensor(memory[8].u8, SB_UINT8, 1, N, 0, 0);
  counts = tensor(memory[8].i64, SB_INT64, 1, N, 0, 0);
  REFUSED(sb_keep_weighted_sample(TEST_DEVICE, &row, -1, 0, 0, &mask));
  REFUSED(sb_keep_largest(TEST_DEVICE, &row, INT64_MIN, &mask));
  REFUSED(sb_importance_scores(TEST_DEVICE, &counts, -1, &counts));
  REFUSED(sb_mean_squared_neighbor_distances(TEST_DEVICE, &scene.t[0], 0, &distances));
  REFUSED(sb_mean_squared_neighbor_distances(TEST_DEVICE, &scene.t[0], INT32_MAX, &distances));
  REFUSED(sb_adam_step(TEST_DEVICE, &row, &row, &row, &row, 0, &adam));
  REFUSED(sb_adam_step(TEST_DEVICE, &row, &row, &row, &row, 1, NULL));
  adam.beta1 = 1;
  REFUSED(sb_adam_step(TEST_DEVICE, &row, &row, &row, &row, 1, &adam));
  adam = adam_options;
  adam.epsilon = NAN;
  REFUSED(sb_adam_step(TEST_DEVICE, &row, &row, &row, &row, 1, &adam));
  REFUSED(sb_mark_visible(TEST_DEVICE, NULL, &scene.t[0], 0.2f, &mask));
  REFUSED(sb_mark_visible(TEST_DEVICE, &camera, &scene.t[0], NAN, &mask));
  REFUSED(sb_flag_errors(TEST_DEVICE, &row, NULL, 0.1f, &row, &mask, NULL));
  REFUSED(sb_photometric_loss(TEST_DEVICE, &row, NULL, 0.1f, NULL, NULL));
  REFUSED(sb_ssim(TEST_DEVICE, &row, &row, 0, NULL, NULL));
  REFUSED(sb_steps_at(NULL, 1, 2, &i32));
  REFUSED(sb_steps_at(&intervals, 1, 2, NULL));
  REFUSED(sb_steps_at(&intervals, 1, 0, &i32));
  intervals.late = 0;
  REFUSED(sb_steps_at(&intervals, 1, 2, &i32));
  intervals.late = 1;
  intervals.early_end = INT32_MIN;
  REFUSED(sb_steps_at(&intervals, 1, 2, &i32));
  REFUSED(sb_scaled_iteration(-1, 2, 3, &i32));
  REFUSED(sb_scaled_iteration(INT32_MAX, INT32_MAX, 1, &i32));
  REFUSED(sb_scaled_iteration(1, 1, 1, NULL));
  REFUSED(sb_exponential_rate(0, 1, 1, 1, &d));
  REFUSED(sb_exponential_rate(NAN, 1, 1, 1, &d));
  REFUSED(sb_exponential_rate(1, 1, 1, 0, &d));
  REFUSED(sb_exponential_rate(1, 1, 1, 1, NULL));

  REFUSED(sb_adapter_beta(NULL, &beta));
  REFUSED(sb_adapter_beta(adapter, NULL));
  REFUSED(sb_adapter_grows_at(NULL, 1, 1, 0, &i32));
  REFUSED(sb_adapter_grows_at(adapter, -1, 1, 0, &i32));
  REFUSED(sb_adapter_grows_at(adapter, 1, 0, 0, &i32));
  REFUSED(sb_adapter_grows_at(adapter, 1, 1, 0, NULL));
  REFUSED(sb_adapter_prunes_at(NULL, 1, 1, 0, &i32));
  REFUSED(sb_adapter_prunes_at(adapter, 1, INT32_MIN, 0, &i32));
  REFUSED(sb_adapter_averages_at(NULL, 1, 1, &i32));
  REFUSED(sb_adapter_averages_at(adapter, 1, 0, &i32));
  REFUSED(sb_adapter_averages_at(adapter, 1, 1, NULL));
  REFUSED(sb_adapter_prunes_large_at(NULL, 1, 1, 1, &i32));
  REFUSED(sb_adapter_prunes_large_at(adapter, 1, 0, 1, &i32));
  REFUSED(sb_adapter_prunes_large_at(adapter, 1, 1, 1, NULL));
  REFUSED(sb_adapter_resets_opacities_at(NULL, 1, 1, 1, &i32));
  REFUSED(sb_adapter_resets_opacities_at(adapter, 1, 0, 1, &i32));
  REFUSED(sb_adapter_resets_opacities_at(adapter, 1, 1, 1, NULL));
  REFUSED(sb_adapter_steps_at(adapter, NULL, 1, 1, &i32));
  REFUSED(sb_adapter_steps_at(adapter, "xyz", 1, -1, &i32));
  REFUSED(sb_adapter_rate_factor(NULL, "xyz", 1, 1, &beta));
  REFUSED(sb_adapter_rate_factor(adapter, NULL, 1, 1, &beta));
  REFUSED(sb_adapter_rate_factor(adapter, "xyz", -1, 1, &beta));
  REFUSED(sb_adapter_rate_factor(adapter, "xyz", 1, 0, &beta));
  REFUSED(sb_adapter_rate_factor(adapter, "xyz", 1, 1, NULL));
  {
    sb_density density = host_density(&grow_entry);
    sb_views views = host_views();
    const sb_tensor *clone = &grow_entry.t[3], *split = &grow_entry.t[4];
    host_entry = &grow_entry;
    REFUSED(sb_adapter_grow(NULL, &density, &views, clone, split, NULL));
    REFUSED(sb_adapter_grow(adapter, NULL, &views, clone, split, NULL));
    REFUSED(sb_adapter_grow(adapter, &density, NULL, clone, split, NULL));
    REFUSED(sb_adapter_prune(NULL, &density, &views, clone, NULL, NULL));
    REFUSED(sb_adapter_prune(adapter, NULL, &views, clone, NULL, NULL));
    REFUSED(sb_adapter_prune(adapter, &density, NULL, clone, NULL, NULL));
    views.render = NULL;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    views = host_views();
    views.count_flagged = NULL;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    views = host_views();
    views.add_weights = NULL;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    views = host_views();
    views.primitives = -1;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    views.primitives = INT64_MAX;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    views = host_views();
    views.views = INT64_MAX;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    views = host_views();
    density.iteration = -5;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
    density.iteration = 600;
    density.scene_extent = NAN;
    REFUSED(sb_adapter_grow(adapter, &density, &views, clone, split, NULL));
  }
}

int main(void) {
  const sb_device one_thread = {TEST_KIND, 0, 1, NULL};
  sb_boost* boost = NULL;
  camera = test_camera();
  camera.width = W;
  camera.height = H;
  CHECK(sb_raster_options_default(&raster_options) == SB_OK);
  CHECK(sb_rasterizer_create(&one_thread, &rasterizer) == SB_OK);
  CHECK(sb_convex_rasterizer_create(&one_thread, &convex_rasterizer) == SB_OK);
  CHECK(sb_boost_create("vanilla", 0, &boost) == SB_OK);
  CHECK(sb_adapter_create(boost, 0, &one_thread, &adapter) == SB_OK);
  sb_boost_destroy(boost);
  fuzz_tensors();
  fill_memory();
  fuzz_devices();
  fuzz_structs();
  refuses_convexes();
  fuzz_values();
  fuzz_numbers();
  sb_convex_rasterizer_destroy(convex_rasterizer);
  sb_rasterizer_destroy(rasterizer);
  sb_adapter_destroy(adapter);
  if (failures == 0) printf("nothing broke\n");
  return failures == 0 ? 0 : 1;
}
