// SPDX-License-Identifier: Apache-2.0
#include "reference/convexes.h"

#include <algorithm>
#include <cmath>

#include "reference/harmonics.h"

namespace splatboost::reference {
namespace {

constexpr int kSeeds = 16;
using Wide = Dual<kSeeds>;
// Half a unit in the last place of a float near 1.
constexpr double kFloatRounding = 6e-8;
/// Amounts by which an implementation may move the edges of a footprint, in pixels and as a fraction of their reach.
constexpr double kFootprintSlack = 0.06, kReachSlack = 3e-4;

template <class Scalar>
struct Edge {
  Scalar x, y, offset;  ///< L(q) = x·q_x + y·q_y + offset
};

/// A projected convex.
template <class Scalar>
struct Shape {
  bool drawn = false;
  bool uncertain = false;
  Scalar depth;
  double centre_x = 0, centre_y = 0;
  double farthest_vertex = 0;
  std::vector<Edge<Scalar>> edges;  ///< in order around the hull
  std::array<Scalar, 3> color;
  Scalar opacity, scale, steepness;  ///< scale: z·δ·pixel_size²
};

/// Colour seen by the camera, in the direction to the mean of the points.
template <class Scalar>
std::array<Scalar, 3> color_of(const ConvexScene<Scalar>& scene, std::size_t i, const std::array<Scalar, 3>& mean,
                               const Camera& camera, const ConvexOptions& options, bool& uncertain) {
  using std::sqrt;
  std::array<Scalar, 3> color;
  if (scene.sh_dc.empty()) {
    for (std::size_t c = 0; c < 3; ++c) color[c] = scene.colors[3 * i + c];
    return color;
  }
  std::array<Scalar, 3> ray;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double eye = 0;
    for (std::size_t k = 0; k < 3; ++k) eye -= camera.rotation[k][axis] * camera.translation[k];
    ray[axis] = (options.released_view_direction ? mean[2] : mean[axis]) - eye;
  }
  const Scalar length = sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
  const auto basis = sh_basis<Scalar>(ray[0] / length, ray[1] / length, ray[2] / length);
  const std::size_t used = static_cast<std::size_t>((scene.sh_degree + 1) * (scene.sh_degree + 1));
  for (std::size_t c = 0; c < 3; ++c) {
    Scalar sum = 0.5 + basis[0] * scene.sh_dc[3 * i + c];
    for (std::size_t k = 1; k < used; ++k) {
      sum += basis[k] * scene.sh_rest[(i * static_cast<std::size_t>(scene.sh_rest_rows) + k - 1) * 3 + c];
    }
    if (std::abs(value_of(sum)) < 1e-5) uncertain = true;
    color[c] = value_of(sum) > 0 ? sum : Scalar(0);
  }
  return color;
}

template <class Scalar>
Shape<Scalar> project(const ConvexScene<Scalar>& scene, std::size_t i, const Camera& camera,
                      const ConvexOptions& options) {
  Shape<Scalar> shape;
  const std::size_t n = scene.points_per_convex;
  std::array<Scalar, 3> mean{};
  std::vector<Scalar> u(n), v(n);
  for (std::size_t p = 0; p < n; ++p) {
    std::array<Scalar, 3> at;
    for (std::size_t row = 0; row < 3; ++row) {
      at[row] = Scalar(camera.translation[row]);
      for (std::size_t c = 0; c < 3; ++c) at[row] += camera.rotation[row][c] * scene.points[(i * n + p) * 3 + c];
    }
    if (!(value_of(at[2]) > 0)) return shape;
    for (std::size_t c = 0; c < 3; ++c) mean[c] += scene.points[(i * n + p) * 3 + c] / static_cast<double>(n);
    u[p] = camera.fx * at[0] / at[2] + camera.cx;
    v[p] = camera.fy * at[1] / at[2] + camera.cy;
  }
  std::array<Scalar, 3> centre;
  for (std::size_t row = 0; row < 3; ++row) {
    centre[row] = Scalar(camera.translation[row]);
    for (std::size_t c = 0; c < 3; ++c) centre[row] += camera.rotation[row][c] * mean[c];
  }
  shape.depth = centre[2];
  if (value_of(shape.depth) <= options.near_plane) return shape;
  shape.centre_x = camera.fx * value_of(centre[0]) / value_of(centre[2]) + camera.cx;
  shape.centre_y = camera.fy * value_of(centre[1]) / value_of(centre[2]) + camera.cy;
  for (std::size_t p = 0; p < n; ++p) {
    if (!(std::hypot(value_of(u[p]) - shape.centre_x, value_of(v[p]) - shape.centre_y) < 10000)) return shape;
  }

  // Edges of the hull are those with all other points on one side.
  std::vector<std::size_t> next(n, n);
  std::size_t first = n;
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = 0; b < n; ++b) {
      if (a == b) continue;
      const double dx = value_of(u[b] - u[a]), dy = value_of(v[b] - v[a]);
      bool is_edge = true;
      for (std::size_t c = 0; c < n && is_edge; ++c) {
        if (c == a || c == b) continue;
        const double ex = value_of(u[c] - u[a]), ey = value_of(v[c] - v[a]);
        const double turn = dx * ey - dy * ex;
        if (std::abs(turn) < 1e-4 * (std::hypot(dx, dy) * std::hypot(ex, ey))) shape.uncertain = true;
        is_edge = turn > 0;
      }
      if (!is_edge) continue;
      next[a] = b;
      first = a;
    }
  }
  if (first == n) return shape;
  std::size_t a = first;
  do {
    const std::size_t b = next[a];
    if (b == n) return shape;
    const Scalar x = v[b] - v[a], y = u[a] - u[b];
    shape.edges.push_back({x, y, -(x * u[a] + y * v[a])});
    shape.farthest_vertex =
        std::max(shape.farthest_vertex, std::hypot(value_of(u[a]) - shape.centre_x, value_of(v[a]) - shape.centre_y));
    a = b;
  } while (a != first && shape.edges.size() <= n);
  if (shape.edges.size() < 3) return shape;

  shape.opacity = scene.opacities[i];
  if (!(value_of(shape.opacity) > kAlphaFloor)) return shape;
  shape.scale = shape.depth * scene.smoothness[i] * (options.pixel_size * options.pixel_size);
  shape.steepness = shape.depth * scene.sharpness[i];
  shape.color = color_of(scene, i, mean, camera, options, shape.uncertain);
  shape.drawn = true;
  return shape;
}

/// Greatest φ with opacity·I ≥ 1/255.
template <class Scalar>
double farthest_of(const Shape<Scalar>& shape) {
  return std::log(value_of(shape.opacity) / kAlphaFloor - 1) / value_of(shape.steepness);
}

/// Radius of the released code's square before it is rounded up; 0: not drawn.
template <class Scalar>
double released_radius(const Shape<Scalar>& shape) {
  const double margin = 2.1 / (value_of(shape.scale) * value_of(shape.steepness));
  double sum = 0;
  int corners = 0;
  const std::size_t n = shape.edges.size();
  for (std::size_t k = 0; k < n; ++k) {
    const Edge<Scalar>&a = shape.edges[k], &b = shape.edges[(k + 1) % n];
    const double ax = value_of(a.x), ay = value_of(a.y), bx = value_of(b.x), by = value_of(b.y);
    const double cosine = (ax * bx + ay * by) / (std::hypot(ax, ay) * std::hypot(bx, by));
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
    if (angle <= 0.1 || angle >= 3.0) continue;
    // Intersection of the two lines moved outwards to L = `margin`, by Cramer's rule.
    const double right_a = margin - value_of(a.offset), right_b = margin - value_of(b.offset);
    const double det = ax * by - ay * bx;
    sum += std::hypot((right_a * by - right_b * ay) / det - shape.centre_x,
                      (ax * right_b - bx * right_a) / det - shape.centre_y);
    ++corners;
  }
  return corners == 0 ? 0 : std::max(1.1 * shape.farthest_vertex, sum / corners);
}

/// Whether a square of this radius intersects a tile on one axis, in 3DGS's pixel coordinates (centres at integers).
bool square_meets(double centre, double radius, int tile, int tiles) {
  const int begin = std::clamp(static_cast<int>(std::floor((centre - 0.5 - radius) / kTile)), 0, tiles);
  const int end = std::clamp(static_cast<int>(std::floor((centre - 0.5 + radius + kTile - 1) / kTile)), 0, tiles);
  return tile >= begin && tile < end;
}

/// Whether a rectangle contains a point with scale·L_k ≤ reach for all edges: it is clipped by each of them.
template <class Scalar>
bool rectangle_meets(const Shape<Scalar>& shape, double reach, double slack, double x0, double x1, double y0,
                     double y1) {
  std::vector<std::array<double, 2>> polygon{{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
  for (const Edge<Scalar>& edge : shape.edges) {
    const double ex = value_of(edge.x), ey = value_of(edge.y);
    const double bound = reach / value_of(shape.scale) + slack * (std::abs(ex) + std::abs(ey));
    const auto excess = [&](const std::array<double, 2>& q) {
      return ex * q[0] + ey * q[1] + value_of(edge.offset) - bound;
    };
    std::vector<std::array<double, 2>> left;
    for (std::size_t c = 0; c < polygon.size(); ++c) {
      const auto &from = polygon[c], &to = polygon[(c + 1) % polygon.size()];
      const double a = excess(from), b = excess(to);
      if (a <= 0) left.push_back(from);
      if ((a <= 0) != (b <= 0)) {
        const double t = a / (a - b);
        left.push_back({from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])});
      }
    }
    polygon = left;
    if (polygon.empty()) return false;
  }
  return true;
}

template <class Scalar>
TileListing tile_lists(const Shape<Scalar>& shape, int tile_x, int tile_y, const Camera& camera,
                       const ConvexOptions& options) {
  TileListing listing;
  if (!options.compact) {
    const double radius = released_radius(shape);
    if (radius <= 0) return listing;
    const auto meets = [&](double r, double shift_x, double shift_y) {
      return square_meets(shape.centre_x + shift_x, r, tile_x, camera.tiles_x()) &&
             square_meets(shape.centre_y + shift_y, r, tile_y, camera.tiles_y());
    };
    listing.listed = meets(std::ceil(radius), 0, 0);
    for (const double rounded : {std::ceil(radius * (1 - 1e-5) - 1e-3), std::ceil(radius * (1 + 1e-5) + 1e-3)}) {
      for (const double shift : {-1e-3, 1e-3}) {
        if (meets(rounded, shift, shift) != listing.listed || meets(rounded, shift, -shift) != listing.listed)
          listing.uncertain = true;
      }
    }
    return listing;
  }
  const double farthest = farthest_of(shape);
  const double reach = farthest > 0 ? options.beta * farthest : farthest;
  const double x0 = tile_x * kTile + 0.5, y0 = tile_y * kTile + 0.5;
  const double x1 = std::min(camera.width, (tile_x + 1) * kTile) - 0.5;
  const double y1 = std::min(camera.height, (tile_y + 1) * kTile) - 0.5;
  listing.listed = rectangle_meets(shape, reach, 0, x0, x1, y0, y1);
  // Tiles end at the image's last pixels here, but an implementation may test whole tiles.
  listing.uncertain = !listing.listed && rectangle_meets(shape, reach + kReachSlack * std::abs(reach), kFootprintSlack,
                                                         x0 - kFootprintSlack, tile_x * kTile + 15.5 + kFootprintSlack,
                                                         y0 - kFootprintSlack, tile_y * kTile + 15.5 + kFootprintSlack);
  return listing;
}

template <class To>
ConvexScene<To> lift(const ConvexScene<double>& scene) {
  const auto copy = [](const std::vector<double>& from) { return std::vector<To>(from.begin(), from.end()); };
  ConvexScene<To> result;
  result.count = scene.count;
  result.points_per_convex = scene.points_per_convex;
  result.points = copy(scene.points);
  result.smoothness = copy(scene.smoothness);
  result.sharpness = copy(scene.sharpness);
  result.opacities = copy(scene.opacities);
  result.sh_dc = copy(scene.sh_dc);
  result.sh_rest = copy(scene.sh_rest);
  result.sh_rest_rows = scene.sh_rest_rows;
  result.sh_degree = scene.sh_degree;
  result.colors = copy(scene.colors);
  return result;
}

template <class Scalar>
Scalar pixel_objective(const ConvexRendering<Scalar>& images, const ConvexImageGradients& g, std::size_t pixel,
                       std::size_t pixels) {
  Scalar sum = images.alpha[pixel] * g.alpha[pixel];
  for (std::size_t c = 0; c < 3; ++c) sum += images.color[c * pixels + pixel] * g.color[c * pixels + pixel];
  return sum;
}

}  // namespace

template <class Scalar>
std::vector<Scalar>& field(ConvexScene<Scalar>& scene, ConvexInput input) {
  switch (input) {
    case ConvexInput::points:
      return scene.points;
    case ConvexInput::smoothness:
      return scene.smoothness;
    case ConvexInput::sharpness:
      return scene.sharpness;
    case ConvexInput::opacities:
      return scene.opacities;
    case ConvexInput::sh_dc:
      return scene.sh_dc;
    case ConvexInput::sh_rest:
      return scene.sh_rest;
    default:
      return scene.colors;
  }
}

template <class Scalar>
ConvexRendering<Scalar> render(const ConvexScene<Scalar>& scene, const Camera& camera, const ConvexOptions& options,
                               const BlendObserver& blended) {
  using std::exp, std::log;
  const auto width = static_cast<std::size_t>(camera.width);
  const std::size_t pixels = width * static_cast<std::size_t>(camera.height);
  ConvexRendering<Scalar> result;
  result.color.assign(3 * pixels, Scalar(0));
  result.alpha.assign(pixels, Scalar(0));
  result.uncertain.assign(pixels, 0);
  result.visible.assign(scene.count, 0);
  result.listing_uncertain.assign(scene.count, 0);

  std::vector<Shape<Scalar>> shapes(scene.count);
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < scene.count; ++i) {
    shapes[i] = project(scene, i, camera, options);
    if (shapes[i].drawn) order.push_back(i);
    if (shapes[i].uncertain) result.listing_uncertain[i] = 1;
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return value_of(shapes[a].depth) < value_of(shapes[b].depth); });

  for (int tile_y = 0; tile_y < camera.tiles_y(); ++tile_y) {
    for (int tile_x = 0; tile_x < camera.tiles_x(); ++tile_x) {
      struct Entry {
        std::size_t convex;
        TileListing listing;
      };
      std::vector<Entry> entries;
      for (const std::size_t i : order) {
        const TileListing listing = tile_lists(shapes[i], tile_x, tile_y, camera, options);
        if (listing.listed) {
          ++result.tile_entries;
          result.visible[i] = 1;
        }
        if (listing.uncertain) {
          ++result.uncertain_entries;
          result.listing_uncertain[i] = 1;
        }
        if (listing.listed || listing.uncertain) entries.push_back({i, listing});
      }
      const int x_end = std::min(camera.width, (tile_x + 1) * kTile);
      const int y_end = std::min(camera.height, (tile_y + 1) * kTile);
      for (int row = tile_y * kTile; row < y_end; ++row) {
        for (int column = tile_x * kTile; column < x_end; ++column) {
          const std::size_t pixel = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column);
          const double x = column + 0.5, y = row + 0.5;
          Scalar transmittance(1);
          double transmittance_error = 1e-6, last_depth = -1;
          for (const Entry& entry : entries) {
            const Shape<Scalar>& shape = shapes[entry.convex];
            // φ = max + log Σ exp(t − max)
            std::vector<Scalar> terms;
            double greatest = -1e300, magnitude = 0;
            for (const Edge<Scalar>& edge : shape.edges) {
              terms.push_back(shape.scale * (edge.x * x + edge.y * y + edge.offset));
              greatest = std::max(greatest, value_of(terms.back()));
              magnitude = std::max(magnitude,
                                   value_of(shape.scale) * (std::abs(value_of(edge.x)) * std::abs(x - shape.centre_x) +
                                                            std::abs(value_of(edge.y)) * std::abs(y - shape.centre_y)));
            }
            if (greatest > 1.01 * std::abs(farthest_of(shape)) + 1) continue;
            Scalar sum(0);
            for (const Scalar& term : terms) sum += exp(term - greatest);
            const Scalar phi = greatest + log(sum);
            const Scalar inside = 1.0 / (1.0 + exp(shape.steepness * phi));
            const Scalar raw = shape.opacity * inside;
            const double error =
                1e-6 + 4 * kFloatRounding * value_of(shape.steepness) * (magnitude + std::abs(value_of(phi)));
            const auto close = [&](double threshold) {
              return std::abs(value_of(raw) - threshold) <= error * threshold;
            };
            if (value_of(raw) < kAlphaFloor * (1 - error)) continue;
            if (close(kAlphaFloor) || close(kAlphaCeiling) || shape.uncertain || entry.listing.uncertain) {
              result.uncertain[pixel] = 1;
            }
            if (value_of(raw) < kAlphaFloor || !entry.listing.listed) continue;
            const double depth = value_of(shape.depth);
            if (depth != last_depth && depth - last_depth < 1e-6 * depth) result.uncertain[pixel] = 1;
            last_depth = depth;

            const Scalar alpha = value_of(raw) > kAlphaCeiling ? Scalar(kAlphaCeiling) : raw;
            const Scalar after = transmittance * (1.0 - alpha);
            transmittance_error += error * value_of(alpha) / (1 - value_of(alpha)) + 2 * kFloatRounding;
            if (std::abs(value_of(after) - kTransmittanceFloor) <= transmittance_error * kTransmittanceFloor) {
              result.uncertain[pixel] = 1;
            }
            if (value_of(after) < kTransmittanceFloor) break;  // saturated; this convex is not blended
            const Scalar weight = alpha * transmittance;
            for (std::size_t c = 0; c < 3; ++c) result.color[c * pixels + pixel] += weight * shape.color[c];
            transmittance = after;
            if (blended) blended(pixel, entry.convex, value_of(weight));
          }
          for (std::size_t c = 0; c < 3; ++c) {
            result.color[c * pixels + pixel] += transmittance * options.background[c];
          }
          result.alpha[pixel] = 1.0 - transmittance;
        }
      }
    }
  }
  return result;
}

std::vector<std::int64_t> count_flagged(const ConvexScene<double>& scene, const Camera& camera,
                                        const ConvexOptions& options, const std::vector<std::uint8_t>& flagged) {
  std::vector<std::int64_t> counts(scene.count, 0);
  render<double>(scene, camera, options, [&](std::size_t pixel, std::size_t convex, double) {
    if (flagged[pixel] != 0) ++counts[convex];
  });
  return counts;
}

std::vector<std::int64_t> blending_weights(const ConvexScene<double>& scene, const Camera& camera,
                                           const ConvexOptions& options, std::vector<std::uint8_t>& certain) {
  std::vector<std::int64_t> sums(scene.count, 0);
  certain.assign(scene.count, 1);
  render<double>(scene, camera, options, [&](std::size_t, std::size_t convex, double weight) {
    const double units = 256 * weight;
    sums[convex] += std::llround(units);
    if (std::abs(units - std::floor(units) - 0.5) < 1e-3) certain[convex] = 0;
  });
  return sums;
}

Gradient gradient(const ConvexScene<double>& scene, const Camera& camera, const ConvexOptions& options,
                  const ConvexImageGradients& image_gradients, ConvexInput input) {
  ConvexScene<Wide> lifted = lift<Wide>(scene);
  std::vector<Wide>& values = field(lifted, input);
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  Gradient result{std::vector<double>(values.size()), std::vector<double>(values.size())};
  for (std::size_t begin = 0; begin < values.size(); begin += kSeeds) {
    const std::size_t seeds = std::min<std::size_t>(kSeeds, values.size() - begin);
    for (std::size_t k = 0; k < seeds; ++k) values[begin + k].slopes[k] = 1;
    const ConvexRendering<Wide> images = render(lifted, camera, options);
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
      const Wide loss = pixel_objective(images, image_gradients, pixel, pixels);
      for (std::size_t k = 0; k < seeds; ++k) {
        result.sum[begin + k] += loss.slopes[k];
        result.absolute_sum[begin + k] += std::abs(loss.slopes[k]);
      }
    }
    for (std::size_t k = 0; k < seeds; ++k) values[begin + k].slopes[k] = 0;
  }
  return result;
}

double objective(const ConvexScene<double>& scene, const Camera& camera, const ConvexOptions& options,
                 const ConvexImageGradients& image_gradients) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  const ConvexRendering<double> images = render(scene, camera, options);
  double sum = 0;
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) sum += pixel_objective(images, image_gradients, pixel, pixels);
  return sum;
}

template std::vector<double>& field(ConvexScene<double>&, ConvexInput);
template ConvexRendering<double> render(const ConvexScene<double>&, const Camera&, const ConvexOptions&,
                                        const BlendObserver&);

}  // namespace splatboost::reference
