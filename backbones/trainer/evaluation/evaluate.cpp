// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/evaluate.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>

#include "trainer/dataset/smaller_view.h"
#include "trainer/dataset/view_image.h"
#include "trainer/support/atomic_file.h"

namespace splatboost {
namespace {

// Rendering is timed until both are reached: enough for a stable median, and short compared with a run.
constexpr double kTimedSeconds = 1.0;
constexpr std::size_t kTimedRenders = 20;
// Upper limit of the timing, for large scenes on slow machines.
constexpr double kMaxTiming = 10.0;

constexpr int kSsimWindow = 11;  // pixels

// File systems allow 255 bytes; an extension and a number are appended.
constexpr std::size_t kMaxPictureName = 230;

/// The text (UTF-8) cut to at most `bytes` bytes, without splitting a character.
std::string cut(const std::string& text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xc0) == 0x80) --bytes;
  return text.substr(0, bytes);
}

std::size_t image_floats(const Camera& camera) {
  return 3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

void render_clamped(Backbone& backbone, const View& view, std::optional<float> beta, std::vector<float>& color) {
  color.resize(image_floats(view.camera));
  backbone.render(view.camera, view.time, beta, color);
  for (float& value : color) value = std::clamp(value, 0.0f, 1.0f);
}

/// Frames per second: one over the median time of a render, after one warm-up render.
double measure_fps(Backbone& backbone, const std::vector<View>& views) {
  using Clock = std::chrono::steady_clock;
  const auto seconds_since = [](Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  std::vector<float> color(image_floats(views[0].camera));
  backbone.render(views[0].camera, views[0].time, std::nullopt, color);
  std::vector<double> times;
  const auto begin = Clock::now();
  while ((times.size() < kTimedRenders || seconds_since(begin) < kTimedSeconds) && seconds_since(begin) < kMaxTiming) {
    const View& view = views[times.size() % views.size()];
    color.resize(image_floats(view.camera));
    const auto start = Clock::now();
    backbone.render(view.camera, view.time, std::nullopt, color);
    times.push_back(seconds_since(start));
  }
  const auto middle = times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2);
  std::nth_element(times.begin(), middle, times.end());
  return 1.0 / std::max(*middle, 1e-9);
}

/// The scales of the usual protocol for a model trained at scale 1: 1, 1/2, 1/4, 1/8.
constexpr int kScaleDivisors[] = {1, 2, 4, 8};

bool shows_something(const View& view) {
  return view.valid.empty() || std::ranges::any_of(view.valid, [](std::uint8_t valid) { return valid != 0; });
}

/// Quality at the trained scale and at smaller ones, rendered as trained. A pixel of a smaller scale is valid if all
/// its pixels are; views without valid pixels do not count in the means of that scale.
std::vector<ScaleResult> measure_scales(Backbone& backbone, const std::vector<View>& views) {
  std::vector<ScaleResult> scales;
  std::vector<float> color;
  for (const int divisor : kScaleDivisors) {
    ScaleResult scale;
    scale.divisor = divisor;
    int measured = 0;
    for (const View& view : views) {
      if (std::min(view.camera.width, view.camera.height) / divisor < kSsimWindow) return scales;
      const View smaller = smaller_view(view, divisor);
      if (!shows_something(smaller)) continue;
      render_clamped(backbone, smaller, std::nullopt, color);
      scale.psnr += psnr(color, smaller.truth());
      scale.ssim += ssim(color, smaller.truth());
      ++measured;
    }
    if (measured == 0) return scales;
    scale.psnr /= measured;
    scale.ssim /= measured;
    scales.push_back(scale);
  }
  return scales;
}

/// Writes planar RGB as a PNG, which is interleaved.
template <class T, class Convert>
void write_planar(const std::filesystem::path& path, std::span<const T> color, int width, int height, Convert convert) {
  const std::size_t plane = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<std::uint8_t> pixels(3 * plane);
  for (std::size_t p = 0; p < plane; ++p) {
    for (std::size_t c = 0; c < 3; ++c) pixels[3 * p + c] = convert(color[c * plane + p]);
  }
  write_png(path, width, height, 3, std::span<const std::uint8_t>(pixels));
}

}  // namespace

const std::vector<View>& measured_views(const Scene& scene) { return scene.test.empty() ? scene.train : scene.test; }

MeasuredView measure_view(Backbone& backbone, const View& view, Lpips* lpips, std::vector<float>& color) {
  MeasuredView measured;
  render_clamped(backbone, view, 1.0f, color);
  measured.psnr_beta1 = psnr(color, view.truth());
  const auto start = std::chrono::steady_clock::now();
  render_clamped(backbone, view, std::nullopt, color);
  measured.render_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  measured.result.name = view.name;
  measured.result.psnr = psnr(color, view.truth());
  measured.result.ssim = ssim(color, view.truth());
  if (lpips) measured.result.lpips = lpips->distance(color, view.truth());
  return measured;
}

double quick_psnr(Backbone& backbone, const Scene& scene, int count) {
  const std::vector<View>& views = measured_views(scene);
  const std::size_t n = std::min(views.size(), static_cast<std::size_t>(count));
  std::vector<float> color;
  double sum = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const View& view = views[i * views.size() / n];
    render_clamped(backbone, view, std::nullopt, color);
    sum += psnr(color, view.truth());
  }
  return sum / static_cast<double>(n);
}

void evaluate(Backbone& backbone, const Scene& scene, Lpips* lpips, const std::filesystem::path& renders,
              Results& results) {
  const std::vector<View>& views = measured_views(scene);
  if (views.empty()) throw std::invalid_argument("evaluate() needs a view");
  if (!renders.empty()) make_folder(renders);
  const std::vector<std::string> names = picture_names(views);
  results.split = scene.test.empty() ? "train" : "test";
  results.views.clear();
  double psnr_sum = 0;
  double psnr_beta1_sum = 0;
  double ssim_sum = 0;
  double lpips_sum = 0;
  std::vector<float> color;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const View& view = views[i];
    MeasuredView measured = measure_view(backbone, view, lpips, color);
    if (!renders.empty()) write_png(renders / (names[i] + ".png"), color, view.camera.width, view.camera.height);
    psnr_sum += measured.result.psnr;
    psnr_beta1_sum += measured.psnr_beta1;
    ssim_sum += measured.result.ssim;
    lpips_sum += measured.result.lpips.value_or(0);
    results.views.push_back(std::move(measured.result));
  }
  const double n = static_cast<double>(views.size());
  results.psnr = psnr_sum / n;
  results.ssim = ssim_sum / n;
  results.lpips = lpips ? std::optional<double>(lpips_sum / n) : std::nullopt;
  results.psnr_beta1 = psnr_beta1_sum / n;
  results.scales = measure_scales(backbone, views);
  results.fps = measure_fps(backbone, views);
}

std::vector<std::string> picture_names(const std::vector<View>& views) {
  const auto stem = [](const View& view) { return std::filesystem::path(view.name).stem().string(); };
  std::map<std::string, int> uses;
  for (const View& view : views) ++uses[stem(view)];
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const View& view : views) {
    std::string name = stem(view);
    if (uses[name] > 1) {
      // Views may have the same stem, as 0001.jpg and 0001.png: the whole name is more often unique.
      name = view.name;
      std::replace(name.begin(), name.end(), '/', '_');
    }
    name = cut(name, kMaxPictureName);
    std::string unused = name;
    for (int number = 2; !taken.insert(unused).second; ++number) unused = name + "_" + std::to_string(number);
    names.push_back(std::move(unused));
  }
  return names;
}

void write_png(const std::filesystem::path& path, std::span<const float> color, int width, int height) {
  write_planar(path, color, width, height, [](float value) {
    const float clamped = std::isnan(value) ? 0.0f : std::clamp(value, 0.0f, 1.0f);
    return static_cast<std::uint8_t>(std::lround(clamped * 255.0f));
  });
}

void write_png(const std::filesystem::path& path, std::span<const std::uint8_t> color, int width, int height) {
  write_planar(path, color, width, height, [](std::uint8_t value) { return value; });
}

}  // namespace splatboost
