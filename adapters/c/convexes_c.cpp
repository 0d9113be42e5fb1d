// SPDX-License-Identifier: Apache-2.0
// The entries of the rasterizer of convexes.
#include <string>

#include "c/c_api_edge.h"
#include "splatboost/c_api.h"
#include "splatboost/convex_rasterizer.h"

namespace edge = splatboost::edge;
using edge::guarded;
using edge::need;
using edge::Place;
using edge::size_of;

namespace {

/// Properties of the convexes of a forward pass that the passes after it rely on.
struct DrawnConvexes {
  std::size_t count = 0;
  int points_per_convex = 0, sh_rest_rows = 0, sh_degree = 0;
  bool colors = false;
  bool operator==(const DrawnConvexes&) const = default;
};

DrawnConvexes shape_of(const splatboost::Convexes& c) {
  return {c.count, c.points_per_convex, c.sh_rest_rows, c.sh_degree, !c.colors.empty()};
}

splatboost::Convexes convexes_of(const Place& place, const sb_convexes* convexes) {
  const sb_convexes& c = need(convexes, "convexes");
  const std::int64_t n = size_of(c.points, "points"), k = size_of(c.points, "points", 1);
  splatboost::Convexes out;
  out.count = static_cast<std::size_t>(n);
  out.points = place.view<const float>(c.points, "points", {n, k, 3});
  SPLATBOOST_CHECK(k >= splatboost::kMinConvexPoints && k <= splatboost::kMaxConvexPoints,
                   "points: expected 3 to 8 points per convex, got " + std::to_string(k));
  out.points_per_convex = static_cast<int>(k);
  out.smoothness = place.view<const float>(c.smoothness, "smoothness", {{n}, {n, 1}});
  out.sharpness = place.view<const float>(c.sharpness, "sharpness", {{n}, {n, 1}});
  out.opacities = place.view<const float>(c.opacities, "opacities", {{n}, {n, 1}});
  edge::colors_of(place, c, n, out);
  return out;
}

splatboost::ConvexOptions convex_options_of(const sb_convex_options* options) {
  const sb_convex_options& o = need(options, "options");
  SPLATBOOST_CHECK(o.box == SB_CONVEX_BOX_SQUARE || o.box == SB_CONVEX_BOX_COMPACT,
                   "options.box must be SB_CONVEX_BOX_SQUARE or SB_CONVEX_BOX_COMPACT, not " + std::to_string(o.box));
  splatboost::ConvexOptions out;
  out.box = o.box == SB_CONVEX_BOX_SQUARE ? splatboost::ConvexBox::square : splatboost::ConvexBox::compact;
  out.beta = o.beta;
  out.near_plane = o.near_plane;
  out.pixel_size = o.pixel_size;
  out.background = {o.background[0], o.background[1], o.background[2]};
  out.released_view_direction = o.released_view_direction != 0;
  return out;
}

}  // namespace

struct sb_convex_rasterizer {
  explicit sb_convex_rasterizer(const sb_device* device)
      : place(device), rasterizer([&] {
          const Place::Call call(place, device != nullptr ? device->stream : nullptr);
          return splatboost::ConvexRasterizer(place.device());
        }()) {}

  Place place;
  splatboost::ConvexRasterizer rasterizer;
  bool drawn = false;  ///< whether the last forward pass succeeded
  DrawnConvexes shape;
  std::int64_t width = 0, height = 0;

  void check_drawn(const char* what) const {
    if (!drawn) throw splatboost::ArgumentError(std::string(what) + " needs a successful forward before it");
  }
};

sb_status sb_convex_rasterizer_create(const sb_device* device, sb_convex_rasterizer** rasterizer) {
  return guarded([&] {
    need(rasterizer, "rasterizer") = nullptr;
    *rasterizer = new sb_convex_rasterizer(device);
  });
}

void sb_convex_rasterizer_destroy(sb_convex_rasterizer* rasterizer) { delete rasterizer; }

sb_status sb_convex_rasterizer_forward(sb_convex_rasterizer* rasterizer, const sb_camera* camera,
                                       const sb_convexes* convexes, const sb_convex_options* options,
                                       const sb_convex_outputs* outputs, void* stream) {
  return guarded([&] {
    sb_convex_rasterizer& r = need(rasterizer, "rasterizer");
    const sb_convex_outputs& to = need(outputs, "outputs");
    Place& place = r.place;
    const Place::Call call(place, stream);
    const splatboost::Camera view = edge::camera_of(camera);
    const splatboost::Convexes in = convexes_of(place, convexes);
    const splatboost::ConvexOptions how = convex_options_of(options);
    const std::int64_t w = view.width, h = view.height, n = static_cast<std::int64_t>(in.count);
    const auto color = place.view<float>(to.color, "color", {3, h, w});
    const auto alpha = place.optional_view<float>(to.alpha, "alpha", {{1, h, w}, {h, w}});
    const auto visible = place.optional_view<std::uint8_t>(to.visible, "visible", {n});

    r.drawn = false;
    r.rasterizer.forward(view, in, how, color, alpha);
    if (!visible.empty()) edge::copy(r.rasterizer.visible(), visible, place.device());
    r.shape = shape_of(in);
    r.width = w;
    r.height = h;
    r.drawn = true;
  });
}

sb_status sb_convex_rasterizer_backward(sb_convex_rasterizer* rasterizer, const sb_convexes* convexes,
                                        const sb_tensor* color, const sb_tensor* alpha,
                                        const sb_convex_gradients* gradients, void* stream) {
  return guarded([&] {
    sb_convex_rasterizer& r = need(rasterizer, "rasterizer");
    const sb_convex_gradients& to = need(gradients, "gradients");
    Place& place = r.place;
    const Place::Call call(place, stream);
    r.check_drawn("backward");
    const splatboost::Convexes in = convexes_of(place, convexes);
    if (!(shape_of(in) == r.shape)) throw splatboost::ArgumentError("backward needs the convexes of the last forward");
    const std::int64_t w = r.width, h = r.height, n = static_cast<std::int64_t>(in.count);
    const auto of_color = place.optional_view<const float>(color, "gradient of color", {3, h, w});
    const auto of_alpha = place.optional_view<const float>(alpha, "gradient of alpha", {{1, h, w}, {h, w}});

    splatboost::ConvexGradients out;
    out.mode = to.accumulate != 0 ? splatboost::GradientMode::accumulate : splatboost::GradientMode::overwrite;
    out.points = place.optional_view<float>(to.points, "gradients.points", {n, in.points_per_convex, 3});
    out.smoothness = place.optional_view<float>(to.smoothness, "gradients.smoothness", {{n}, {n, 1}});
    out.sharpness = place.optional_view<float>(to.sharpness, "gradients.sharpness", {{n}, {n, 1}});
    out.opacities = place.optional_view<float>(to.opacities, "gradients.opacities", {{n}, {n, 1}});
    out.sh_dc = place.optional_view<float>(to.sh_dc, "gradients.sh_dc", {{n, 3}, {n, 1, 3}});
    out.sh_rest = place.optional_view<float>(to.sh_rest, "gradients.sh_rest", {n, in.sh_rest_rows, 3});
    out.colors = place.optional_view<float>(to.colors, "gradients.colors", {n, 3});
    out.view_sharpness_abs = place.optional_view<float>(to.sharpness_abs, "gradients.sharpness_abs", {n});
    out.screen_points = place.optional_view<float>(to.screen_points, "gradients.screen_points", {n, 3});
    r.rasterizer.backward(in, of_color, of_alpha, out);
  });
}

sb_status sb_convex_rasterizer_count_flagged(sb_convex_rasterizer* rasterizer, const sb_tensor* flagged,
                                             const sb_tensor* counts, void* stream) {
  return guarded([&] {
    sb_convex_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("count_flagged");
    r.rasterizer.count_flagged(
        r.place.view<const std::uint8_t>(flagged, "flagged", {r.height, r.width}),
        r.place.view<std::int32_t>(counts, "counts", {static_cast<std::int64_t>(r.shape.count)}));
  });
}

sb_status sb_convex_rasterizer_add_weights(sb_convex_rasterizer* rasterizer, const sb_tensor* weights, void* stream) {
  return guarded([&] {
    sb_convex_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("add_weights");
    r.rasterizer.add_weights(
        r.place.view<std::int32_t>(weights, "weights", {static_cast<std::int64_t>(r.shape.count)}));
  });
}
