// SPDX-License-Identifier: Apache-2.0
#include "reference/rasterizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "reference/harmonics.h"

namespace splatboost::reference {
namespace {

// Half a unit in the last place of a float near 1. Bounds of single-precision rounding are multiples of it.
constexpr double kFloatRounding = 6e-8;
constexpr int kSeeds = 16;
using Wide = Dual<kSeeds>;
using Narrow = Dual<1>;

double squared(double x) { return x * x; }

/// Whether x is within a relative distance of a threshold.
bool near(double x, double threshold, double relative) {
  return std::abs(x - threshold) <= relative * std::abs(threshold);
}

template <class Scalar>
using Matrix3 = std::array<std::array<Scalar, 3>, 3>;

template <class Scalar>
Matrix3<Scalar> rotation_of_quaternion(const Scalar* q) {
  using std::sqrt;
  const Scalar length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const Scalar w = q[0] / length;
  const Scalar x = q[1] / length;
  const Scalar y = q[2] / length;
  const Scalar z = q[3] / length;
  return {{{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)},
           {2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)},
           {2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)}}};
}

template <class Scalar>
Matrix3<Scalar> world_covariance(const Scene<Scalar>& scene, std::size_t i) {
  Matrix3<Scalar> sigma;
  if (scene.scales.empty()) {
    const Scalar* c = &scene.covariances[6 * i];
    return {{{c[0], c[1], c[2]}, {c[1], c[3], c[4]}, {c[2], c[4], c[5]}}};
  }
  const Matrix3<Scalar> axes = rotation_of_quaternion(&scene.rotations[4 * i]);
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      Scalar sum(0);
      for (std::size_t k = 0; k < 3; ++k) {
        const Scalar& scale = scene.scales[3 * i + k];
        sum += axes[row][k] * axes[column][k] * scale * scale;
      }
      sigma[row][column] = sum;
    }
  }
  return sigma;
}

/// Colour seen by the camera. Its derivative with respect to the mean, through the direction, is included.
template <class Scalar>
std::array<Scalar, 3> color_of(const Scene<Scalar>& scene, std::size_t i, const Camera& camera, bool& uncertain) {
  using std::sqrt;
  std::array<Scalar, 3> color;
  if (scene.sh_dc.empty()) {
    for (std::size_t c = 0; c < 3; ++c) color[c] = scene.colors[3 * i + c];
    return color;
  }
  std::array<Scalar, 3> direction;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double centre = 0;  // camera centre, −Rᵀ·translation
    for (std::size_t k = 0; k < 3; ++k) centre -= camera.rotation[k][axis] * camera.translation[k];
    direction[axis] = scene.means[3 * i + axis] - centre;
  }
  const Scalar length = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
  const auto basis = sh_basis<Scalar>(direction[0] / length, direction[1] / length, direction[2] / length);
  const std::size_t used = static_cast<std::size_t>((scene.sh_degree + 1) * (scene.sh_degree + 1));
  for (std::size_t c = 0; c < 3; ++c) {
    Scalar sum = 0.5 + basis[0] * scene.sh_dc[3 * i + c];
    double magnitude = 0.5;
    for (std::size_t k = 1; k < used; ++k) {
      const Scalar& coefficient = scene.sh_rest[(i * static_cast<std::size_t>(scene.sh_rest_rows) + k - 1) * 3 + c];
      sum += basis[k] * coefficient;
      magnitude += std::abs(value_of(basis[k]) * value_of(coefficient));
    }
    if (std::abs(value_of(sum)) < 1e-5 * magnitude) uncertain = true;
    color[c] = value_of(sum) > 0 ? sum : Scalar(0);
  }
  return color;
}

/// Tiles [begin, end) of one axis that the 3σ square touches, in 3DGS's pixel coordinates (centres at integers).
struct TileRange {
  int begin = 0;
  int end = 0;
};

TileRange square_range(double position, int radius, int tiles) {
  const double begin = std::floor((position - radius) / kTile);
  const double end = std::floor((position + radius + kTile - 1) / kTile);
  return {static_cast<int>(std::clamp(begin, 0.0, static_cast<double>(tiles))),
          static_cast<int>(std::clamp(end, 0.0, static_cast<double>(tiles)))};
}

TileListing square_lists(double position, const int (&radii)[3], int tile, int tiles) {
  const double slack = 8 * kFloatRounding * (std::abs(position) + radii[2] + kTile);
  TileListing result;
  const TileRange range = square_range(position, radii[1], tiles);
  result.listed = tile >= range.begin && tile < range.end;
  for (const int radius : radii) {
    for (const double shift : {-slack, slack}) {
      const TileRange other = square_range(position + shift, radius, tiles);
      if ((tile >= other.begin && tile < other.end) != result.listed) result.uncertain = true;
    }
  }
  return result;
}

/// An upper bound of the relative error of alpha caused by rounding ½·dᵀ conic d in single precision.
template <class Scalar>
double alpha_error(const Splat<Scalar>& splat, double exponent, const Camera& camera) {
  const double position = std::abs(value_of(splat.x)) + std::abs(value_of(splat.y)) + camera.width + camera.height;
  return kFloatRounding *
         (16 + 16 * splat.condition * exponent + 8 * position * std::sqrt(2 * exponent * splat.conic_norm));
}

template <class Scalar>
Scene<Scalar> lift(const Scene<double>& scene) {
  const auto copy = [](const std::vector<double>& from) { return std::vector<Scalar>(from.begin(), from.end()); };
  Scene<Scalar> result;
  result.count = scene.count;
  result.sh_rest_rows = scene.sh_rest_rows;
  result.sh_degree = scene.sh_degree;
  result.features_per_gaussian = scene.features_per_gaussian;
  result.means = copy(scene.means);
  result.scales = copy(scene.scales);
  result.rotations = copy(scene.rotations);
  result.covariances = copy(scene.covariances);
  result.opacities = copy(scene.opacities);
  result.sh_dc = copy(scene.sh_dc);
  result.sh_rest = copy(scene.sh_rest);
  result.colors = copy(scene.colors);
  result.features = copy(scene.features);
  result.screen_means = copy(scene.screen_means);
  return result;
}

/// Σ image · image gradient at one pixel.
template <class Scalar>
Scalar pixel_objective(const Rendering<Scalar>& images, const ImageGradients& gradients, std::size_t pixel,
                       std::size_t pixels) {
  Scalar sum(0);
  const auto add = [&](const std::vector<Scalar>& image, const std::vector<double>& weights) {
    for (std::size_t at = pixel; at < weights.size(); at += pixels) {
      if (weights[at] != 0) sum += image[at] * weights[at];
    }
  };
  add(images.color, gradients.color);
  add(images.features, gradients.features);
  add(images.inverse_depth, gradients.inverse_depth);
  add(images.alpha, gradients.alpha);
  return sum;
}

}  // namespace

template <class Scalar>
std::vector<Scalar>& field(Scene<Scalar>& scene, Input input) {
  switch (input) {
    case Input::means:
      return scene.means;
    case Input::scales:
      return scene.scales;
    case Input::rotations:
      return scene.rotations;
    case Input::covariances:
      return scene.covariances;
    case Input::opacities:
      return scene.opacities;
    case Input::sh_dc:
      return scene.sh_dc;
    case Input::sh_rest:
      return scene.sh_rest;
    case Input::colors:
      return scene.colors;
    case Input::features:
      return scene.features;
    case Input::screen_means:
      return scene.screen_means;
  }
  throw std::logic_error("unknown input");
}

template <class Scalar>
Splat<Scalar> project(const Scene<Scalar>& scene, std::size_t i, const Camera& camera, const Options& options) {
  using std::sqrt;
  Splat<Scalar> splat;

  std::array<Scalar, 3> t;
  for (std::size_t row = 0; row < 3; ++row) {
    t[row] = Scalar(camera.translation[row]);
    for (std::size_t k = 0; k < 3; ++k) t[row] += camera.rotation[row][k] * scene.means[3 * i + k];
  }
  if (!(value_of(t[2]) > options.near_plane)) return splat;
  if (near(value_of(t[2]), options.near_plane, 1e-6)) splat.uncertain = true;

  // Affine approximation of the projection at the mean, clamped to a widened field of view.
  const double limits[2] = {kFieldMargin * camera.width / (2 * camera.fx),
                            kFieldMargin * camera.height / (2 * camera.fy)};
  const double centre_slope[2] = {(camera.width / 2.0 - camera.cx) / camera.fx,
                                  (camera.height / 2.0 - camera.cy) / camera.fy};
  std::array<Scalar, 2> held;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double slope = value_of(t[axis]) / value_of(t[2]);
    const double low = std::min(centre_slope[axis] - limits[axis], 0.0),
                 high = std::max(centre_slope[axis] + limits[axis], 0.0);
    held[axis] = slope > high ? high * t[2] : slope < low ? low * t[2] : t[axis];
    if (near(slope, low, 1e-5) || near(slope, high, 1e-5)) splat.uncertain = true;
  }
  const std::array<std::array<Scalar, 3>, 2> jacobian = {
      {{camera.fx / t[2], Scalar(0), -(camera.fx * held[0] / (t[2] * t[2]))},
       {Scalar(0), camera.fy / t[2], -(camera.fy * held[1] / (t[2] * t[2]))}}};
  std::array<std::array<Scalar, 3>, 2> image_from_world;
  for (std::size_t row = 0; row < 2; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      Scalar sum(0);
      for (std::size_t k = 0; k < 3; ++k) sum += jacobian[row][k] * camera.rotation[k][column];
      image_from_world[row][column] = sum;
    }
  }
  if (!scene.scales.empty()) {
    double squares = 0;
    for (std::size_t k = 0; k < 4; ++k) squares += squared(value_of(scene.rotations[4 * i + k]));
    const double length = std::sqrt(squares);
    if (!(length >= kShortestQuaternion && length <= kLongestQuaternion)) return splat;
  }
  const Matrix3<Scalar> sigma = world_covariance(scene, i);
  const auto screen_covariance = [&](std::size_t row, std::size_t column) {
    Scalar sum(0);
    for (std::size_t a = 0; a < 3; ++a) {
      for (std::size_t b = 0; b < 3; ++b) sum += image_from_world[row][a] * sigma[a][b] * image_from_world[column][b];
    }
    return sum;
  };
  const Scalar sharp_xx = screen_covariance(0, 0);
  const Scalar xy = screen_covariance(0, 1);
  const Scalar sharp_yy = screen_covariance(1, 1);
  const Scalar xx = sharp_xx + options.low_pass;
  const Scalar yy = sharp_yy + options.low_pass;
  const Scalar determinant = xx * yy - xy * xy;
  if (!(value_of(determinant) > 0) || !std::isfinite(value_of(determinant))) return splat;

  splat.x = camera.fx * t[0] / t[2] + camera.cx;
  splat.y = camera.fy * t[1] / t[2] + camera.cy;
  if (!scene.screen_means.empty()) {
    splat.x += scene.screen_means[2 * i];
    splat.y += scene.screen_means[2 * i + 1];
  }
  splat.depth = t[2];
  splat.conic_xx = yy / determinant;
  splat.conic_xy = -xy / determinant;
  splat.conic_yy = xx / determinant;
  splat.opacity = scene.opacities[i];
  if (options.compensate_opacity) {
    const Scalar ratio = (sharp_xx * sharp_yy - xy * xy) / determinant;
    if (near(value_of(ratio), kCompensation2Floor, 1e-3)) splat.uncertain = true;
    splat.opacity *= value_of(ratio) > kCompensation2Floor ? sqrt(ratio) : Scalar(std::sqrt(kCompensation2Floor));
  }
  splat.color = color_of(scene, i, camera, splat.uncertain);

  const double middle = 0.5 * (value_of(xx) + value_of(yy));
  const double spread = squared(middle) - value_of(determinant);
  const double slack = 8 * kFloatRounding * squared(middle);
  const auto radius = [&](double square) { return 3 * std::sqrt(middle + std::sqrt(std::max(0.1, square))); };
  const double radius_limit = 1e9;
  const double exact = radius(spread);
  if (!std::isfinite(exact) || exact > radius_limit) return splat;
  splat.radius = static_cast<int>(std::ceil(exact));
  splat.radius_low = static_cast<int>(std::ceil(radius(spread - slack) * (1 - 16 * kFloatRounding)));
  splat.radius_high = static_cast<int>(std::ceil(radius(spread + slack) * (1 + 16 * kFloatRounding)));
  splat.condition = (value_of(xx) * value_of(yy) + squared(value_of(xy))) / value_of(determinant);
  splat.conic_norm = value_of(splat.conic_xx) + value_of(splat.conic_yy);
  splat.drawn =
      std::isfinite(value_of(splat.x)) && std::isfinite(value_of(splat.y)) && std::isfinite(value_of(splat.opacity));
  return splat;
}

double smallest_in_rectangle(double conic_xx, double conic_xy, double conic_yy, double x, double y, double x0,
                             double x1, double y0, double y1) {
  if (x >= x0 && x <= x1 && y >= y0 && y <= y1) return 0;
  // The form is convex and its minimum lies outside, so the smallest value is on an edge. Along an edge it is a
  // parabola, whose smallest value is at its vertex, clamped to the edge.
  double smallest = std::numeric_limits<double>::infinity();
  const auto at = [&](double px, double py) {
    const double dx = px - x;
    const double dy = py - y;
    smallest = std::min(smallest, conic_xx * dx * dx + 2 * conic_xy * dx * dy + conic_yy * dy * dy);
  };
  for (const double edge : {x0, x1}) at(edge, std::clamp(y - conic_xy * (edge - x) / conic_yy, y0, y1));
  for (const double edge : {y0, y1}) at(std::clamp(x - conic_xy * (edge - y) / conic_xx, x0, x1), edge);
  return smallest;
}

template <class Scalar>
TileListing tile_lists(const Splat<Scalar>& splat, int tile_x, int tile_y, const Camera& camera,
                       const Options& options) {
  const double x = value_of(splat.x);
  const double y = value_of(splat.y);
  if (!options.ellipse) {
    const int radii[3] = {splat.radius_low, splat.radius, splat.radius_high};
    const TileListing in_x = square_lists(x - 0.5, radii, tile_x, camera.tiles_x());
    const TileListing in_y = square_lists(y - 0.5, radii, tile_y, camera.tiles_y());
    // If it is certainly outside along one axis, the result is certain.
    const bool settled = (!in_x.listed && !in_x.uncertain) || (!in_y.listed && !in_y.uncertain);
    return {in_x.listed && in_y.listed, !settled && (in_x.uncertain || in_y.uncertain)};
  }
  const double level = options.beta * 2 * std::log(value_of(splat.opacity) / kAlphaFloor);
  // Range of the centres of the tile's pixels, including those beyond the image's border.
  const double x0 = kTile * tile_x + 0.5;
  const double y0 = kTile * tile_y + 0.5;
  const auto smallest_with = [&](double slack) {
    return smallest_in_rectangle(value_of(splat.conic_xx), value_of(splat.conic_xy), value_of(splat.conic_yy), x, y,
                                 x0 - slack, x0 + kTile - 1 + slack, y0 - slack, y0 + kTile - 1 + slack);
  };
  const double smallest = smallest_with(0);
  const double error = 2e-5 + 2 * alpha_error(splat, 0.5 * smallest, camera);
  const bool listed = level > 0 && smallest <= level;
  const bool by_a_hair = std::abs(smallest - level) <= error || (std::abs(level) <= error && smallest <= error);
  const bool by_slack = !listed && level > 0 && smallest_with(kTileSlack) <= level;
  return {listed, by_a_hair || by_slack};
}

template <class Scalar>
Rendering<Scalar> render(const Scene<Scalar>& scene, const Camera& camera, const Options& options,
                         const BlendObserver& blended) {
  using std::exp;
  const std::size_t width = static_cast<std::size_t>(camera.width);
  const std::size_t pixels = width * static_cast<std::size_t>(camera.height);
  const std::size_t feature_count = static_cast<std::size_t>(scene.features_per_gaussian);
  Rendering<Scalar> result;
  result.color.resize(3 * pixels);
  result.features.resize(feature_count * pixels);
  result.inverse_depth.resize(pixels);
  result.alpha.resize(pixels);
  result.uncertain.assign(pixels, 0);
  result.visible.assign(scene.count, 0);
  result.listing_uncertain.assign(scene.count, 0);
  result.radii.assign(scene.count, 0);
  result.radii_low.assign(scene.count, 0);
  result.radii_high.assign(scene.count, 0);

  std::vector<Splat<Scalar>> splats(scene.count);
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < scene.count; ++i) {
    splats[i] = project(scene, i, camera, options);
    if (splats[i].drawn) order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return value_of(splats[a].depth) < value_of(splats[b].depth); });

  for (int tile_y = 0; tile_y < camera.tiles_y(); ++tile_y) {
    for (int tile_x = 0; tile_x < camera.tiles_x(); ++tile_x) {
      struct Entry {
        std::size_t gaussian;
        TileListing listing;
      };
      std::vector<Entry> entries;
      for (const std::size_t i : order) {
        const TileListing listing = tile_lists(splats[i], tile_x, tile_y, camera, options);
        if (listing.listed) {
          ++result.tile_entries;
          result.visible[i] = 1;
          result.radii[i] = splats[i].radius;
          result.radii_low[i] = splats[i].radius_low;
          result.radii_high[i] = splats[i].radius_high;
        }
        if (listing.uncertain || splats[i].uncertain) {
          if (listing.uncertain) ++result.uncertain_entries;
          result.listing_uncertain[i] = 1;
        }
        if (listing.listed || listing.uncertain) entries.push_back({i, listing});
      }

      const int x_end = std::min(camera.width, (tile_x + 1) * kTile);
      const int y_end = std::min(camera.height, (tile_y + 1) * kTile);
      for (int row = tile_y * kTile; row < y_end; ++row) {
        for (int column = tile_x * kTile; column < x_end; ++column) {
          const std::size_t pixel = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column);
          Scalar transmittance(1);
          double transmittance_error = 1e-6;
          double last_depth = -1;
          std::array<Scalar, 3> color{};
          std::vector<Scalar> features(feature_count, Scalar(0));
          Scalar inverse_depth(0);
          for (const Entry& entry : entries) {
            const Splat<Scalar>& splat = splats[entry.gaussian];
            // Decide first, with values only, which is fast: most splats do not reach most pixels.
            const double vx = value_of(splat.x) - (column + 0.5);
            const double vy = value_of(splat.y) - (row + 0.5);
            const double exponent = 0.5 * (value_of(splat.conic_xx) * vx * vx + 2 * value_of(splat.conic_xy) * vx * vy +
                                           value_of(splat.conic_yy) * vy * vy);
            const double raw_value = value_of(splat.opacity) * std::exp(-exponent);
            const double error = alpha_error(splat, exponent, camera);
            if (raw_value < kAlphaFloor * (1 - error)) continue;
            if (near(raw_value, kAlphaFloor, error) || near(raw_value, kAlphaCeiling, error) || splat.uncertain ||
                entry.listing.uncertain) {
              result.uncertain[pixel] = 1;
            }
            if (raw_value < kAlphaFloor || !entry.listing.listed) continue;

            const double depth = value_of(splat.depth);
            if (depth != last_depth && depth - last_depth < 1e-6 * depth) result.uncertain[pixel] = 1;
            last_depth = depth;

            const Scalar dx = splat.x - (column + 0.5);
            const Scalar dy = splat.y - (row + 0.5);
            const Scalar raw =
                splat.opacity *
                exp(-0.5 * (splat.conic_xx * dx * dx + 2.0 * splat.conic_xy * dx * dy + splat.conic_yy * dy * dy));
            const Scalar alpha = value_of(raw) > kAlphaCeiling ? Scalar(kAlphaCeiling) : raw;
            const Scalar after = transmittance * (1.0 - alpha);
            transmittance_error += error * value_of(alpha) / (1 - value_of(alpha)) + 2 * kFloatRounding;
            if (near(value_of(after), kTransmittanceFloor, transmittance_error)) result.uncertain[pixel] = 1;
            if (value_of(after) < kTransmittanceFloor) break;  // saturated; this splat is not blended

            const Scalar weight = alpha * transmittance;
            for (std::size_t c = 0; c < 3; ++c) color[c] += weight * splat.color[c];
            for (std::size_t f = 0; f < feature_count; ++f) {
              features[f] += weight * scene.features[entry.gaussian * feature_count + f];
            }
            inverse_depth += weight / splat.depth;
            transmittance = after;
            if (blended) blended(pixel, entry.gaussian, value_of(weight));
          }
          for (std::size_t c = 0; c < 3; ++c) {
            result.color[c * pixels + pixel] = color[c] + transmittance * options.background[c];
          }
          for (std::size_t f = 0; f < feature_count; ++f) result.features[f * pixels + pixel] = features[f];
          result.inverse_depth[pixel] = inverse_depth;
          result.alpha[pixel] = 1.0 - transmittance;
        }
      }
    }
  }
  return result;
}

std::vector<std::int64_t> count_flagged(const Scene<double>& scene, const Camera& camera, const Options& options,
                                        const std::vector<std::uint8_t>& flagged) {
  std::vector<std::int64_t> counts(scene.count, 0);
  render<double>(scene, camera, options, [&](std::size_t pixel, std::size_t gaussian, double) {
    if (flagged[pixel] != 0) ++counts[gaussian];
  });
  return counts;
}

std::vector<std::int64_t> blending_weights(const Scene<double>& scene, const Camera& camera, const Options& options,
                                           std::vector<std::uint8_t>& certain) {
  std::vector<std::int64_t> sums(scene.count, 0);
  certain.assign(scene.count, 1);
  render<double>(scene, camera, options, [&](std::size_t, std::size_t gaussian, double weight) {
    const double units = 256 * weight;
    sums[gaussian] += std::llround(units);
    if (std::abs(units - std::floor(units) - 0.5) < 1e-3) certain[gaussian] = 0;
  });
  return sums;
}

Gradient gradient(const Scene<double>& scene, const Camera& camera, const Options& options,
                  const ImageGradients& image_gradients, Input input, const std::vector<std::size_t>& elements) {
  Scene<Wide> lifted = lift<Wide>(scene);
  std::vector<Wide>& values = field(lifted, input);
  if (input == Input::screen_means) values.assign(2 * scene.count, Wide(0));
  std::vector<std::size_t> wanted = elements;
  if (wanted.empty()) {
    wanted.resize(values.size());
    std::iota(wanted.begin(), wanted.end(), std::size_t{0});
  }
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  Gradient result{std::vector<double>(wanted.size()), std::vector<double>(wanted.size())};
  for (std::size_t begin = 0; begin < wanted.size(); begin += kSeeds) {
    const std::size_t seeds = std::min<std::size_t>(kSeeds, wanted.size() - begin);
    for (std::size_t k = 0; k < seeds; ++k) values[wanted[begin + k]].slopes[k] = 1;
    const Rendering<Wide> images = render(lifted, camera, options);
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
      const Wide loss = pixel_objective(images, image_gradients, pixel, pixels);
      for (std::size_t k = 0; k < seeds; ++k) {
        result.sum[begin + k] += loss.slopes[k];
        result.absolute_sum[begin + k] += std::abs(loss.slopes[k]);
      }
    }
    for (std::size_t k = 0; k < seeds; ++k) values[wanted[begin + k]].slopes[k] = 0;
  }
  return result;
}

double objective(const Scene<double>& scene, const Camera& camera, const Options& options,
                 const ImageGradients& image_gradients) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  const Rendering<double> images = render(scene, camera, options);
  double sum = 0;
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) sum += pixel_objective(images, image_gradients, pixel, pixels);
  return sum;
}

double directional_derivative(const Scene<double>& scene, const Scene<double>& direction, const Camera& camera,
                              const Options& options, const ImageGradients& image_gradients) {
  Scene<Narrow> lifted = lift<Narrow>(scene);
  Scene<double> motion = direction;
  for (const Input input : {Input::means, Input::scales, Input::rotations, Input::covariances, Input::opacities,
                            Input::sh_dc, Input::sh_rest, Input::colors, Input::features, Input::screen_means}) {
    const std::vector<double>& speeds = field(motion, input);
    std::vector<Narrow>& values = field(lifted, input);
    if (speeds.empty()) continue;
    values.resize(speeds.size());
    for (std::size_t k = 0; k < speeds.size(); ++k) values[k].slopes[0] = speeds[k];
  }
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  const Rendering<Narrow> images = render(lifted, camera, options);
  double sum = 0;
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    sum += pixel_objective(images, image_gradients, pixel, pixels).slopes[0];
  }
  return sum;
}

template std::vector<double>& field(Scene<double>&, Input);
template Splat<double> project(const Scene<double>&, std::size_t, const Camera&, const Options&);
template TileListing tile_lists(const Splat<double>&, int, int, const Camera&, const Options&);
template Rendering<double> render(const Scene<double>&, const Camera&, const Options&, const BlendObserver&);

}  // namespace splatboost::reference
