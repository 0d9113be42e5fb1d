// SPDX-License-Identifier: Apache-2.0
// LPIPS with the network of scripts/lpips_to_onnx: it maps one image to seven feature maps ("taps"), already weighted
// by the root of LPIPS's linear layers, and to the squared norm of the unweighted features of each pixel ("norms"). The
// distance of two images is the sum over taps of the mean over pixels of the squared difference of tap / norm.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>

#include "trainer/evaluation/metrics.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr int kTaps = 7;
constexpr double kEpsilon = 1e-10;  // LPIPS's guard against division by zero

// Silences the log of OpenCV: it reports a damaged file both there and by exception, and the exception is enough.
class QuietLog {
 public:
  QuietLog() : level_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~QuietLog() { cv::utils::logging::setLogLevel(level_); }
  QuietLog(const QuietLog&) = delete;
  QuietLog& operator=(const QuietLog&) = delete;

 private:
  cv::utils::logging::LogLevel level_;
};

// OpenCV may prepend a prefix to the output names of the file.
std::vector<cv::String> find_outputs(const cv::dnn::Net& net) {
  const std::vector<cv::String> all = net.getUnconnectedOutLayersNames();
  std::vector<cv::String> found;
  for (int t = 0; t < kTaps; ++t) {
    for (const char* kind : {"tap", "norm"}) {
      const auto at = std::find_if(all.begin(), all.end(), [name = kind + std::to_string(t)](const std::string& layer) {
        return layer.ends_with(name);
      });
      if (at != all.end()) found.push_back(*at);
    }
  }
  return found;
}

bool is_tap_list(const std::vector<cv::Mat>& maps) {
  if (maps.size() != 2 * kTaps) return false;
  for (std::size_t t = 0; t < kTaps; ++t) {
    const cv::Mat& tap = maps[2 * t];
    const cv::Mat& norm = maps[2 * t + 1];
    if (tap.dims != 4 || norm.dims != 4 || norm.size[1] != 1 || tap.size[2] != norm.size[2] ||
        tap.size[3] != norm.size[3]) {
      return false;
    }
  }
  return true;
}

// The mean over pixels of the squared difference of two taps, each divided by its norm.
double tap_distance(const cv::Mat& a, const cv::Mat& norm_a, const cv::Mat& b, const cv::Mat& norm_b) {
  const std::size_t pixels = static_cast<std::size_t>(a.size[2]) * static_cast<std::size_t>(a.size[3]);
  std::vector<double> scale_a(pixels), scale_b(pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    scale_a[p] = 1 / (std::sqrt(static_cast<double>(norm_a.ptr<float>()[p])) + kEpsilon);
    scale_b[p] = 1 / (std::sqrt(static_cast<double>(norm_b.ptr<float>()[p])) + kEpsilon);
  }
  double sum = 0;
  for (int c = 0; c < a.size[1]; ++c) {
    const float* plane_a = a.ptr<float>(0, c);
    const float* plane_b = b.ptr<float>(0, c);
    for (std::size_t p = 0; p < pixels; ++p) {
      const double difference = plane_a[p] * scale_a[p] - plane_b[p] * scale_b[p];
      sum += difference * difference;
    }
  }
  return sum / static_cast<double>(pixels);
}

}  // namespace

struct Lpips::Network {
  cv::dnn::Net net;
  std::vector<cv::String> outputs;  // tap0, norm0, tap1, …
  std::vector<float> image;         // [3,H,W]

  std::vector<cv::Mat> run(int width, int height) {
    const std::array<int, 4> shape{1, 3, height, width};
    net.setInput(cv::Mat(4, shape.data(), CV_32F, image.data()));
    std::vector<cv::Mat> result;
    net.forward(result, outputs);
    // OpenCV returns its internal buffers, which the next run overwrites.
    for (cv::Mat& map : result) map = map.clone();
    return result;
  }

  std::vector<cv::Mat> run_smallest() {
    image = std::vector<float>(std::size_t{3} * kSmallest * kSmallest, 0.5f);
    return run(kSmallest, kSmallest);
  }
};

Lpips::Lpips(const std::filesystem::path& onnx) : network_(std::make_unique<Network>()) {
  if (!std::filesystem::is_regular_file(onnx) || !std::ifstream(onnx)) {
    throw InputError("LPIPS weights: cannot read " + onnx.string() +
                     "; give --lpips its path, or create it with scripts/lpips_to_onnx");
  }
  const QuietLog quiet;
  try {
    network_->net = cv::dnn::readNetFromONNX(onnx.string());
    network_->net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    network_->outputs = find_outputs(network_->net);
    if (is_tap_list(network_->run_smallest())) return;
  } catch (const cv::Exception&) {
  }
  throw InputError("LPIPS weights: " + onnx.string() + " is damaged or was not made by scripts/lpips_to_onnx.");
}

Lpips::~Lpips() = default;

// For an image of another size OpenCV allocates all maps again.
void Lpips::release_memory() { network_->run_smallest(); }

double Lpips::distance(std::span<const float> render, const TruthImage& truth) {
  const std::size_t pixels = static_cast<std::size_t>(truth.width) * static_cast<std::size_t>(truth.height);
  if (render.size() != 3 * pixels || truth.color.size() != 3 * pixels ||
      (!truth.valid.empty() && truth.valid.size() != pixels)) {
    throw std::invalid_argument("LPIPS: render and truth must be [3,H,W], and valid [H,W] or empty");
  }
  if (truth.width < kSmallest || truth.height < kSmallest) {
    throw InputError("LPIPS needs images of at least 32×32 pixels; this one has " + std::to_string(truth.width) + "×" +
                     std::to_string(truth.height) + ".");
  }
  std::vector<float>& image = network_->image;
  image.resize(3 * pixels);
  for (std::size_t i = 0; i < 3 * pixels; ++i) image[i] = static_cast<float>(truth.color[i]) / 255.0f;
  const std::vector<cv::Mat> of_truth = network_->run(truth.width, truth.height);
  for (std::size_t i = 0; i < 3 * pixels; ++i) {
    // `image` still holds the truth; invalid pixels keep it, so that they add no difference.
    if (truth.valid.empty() || truth.valid[i % pixels]) image[i] = std::clamp(render[i], 0.0f, 1.0f);
  }
  const std::vector<cv::Mat> of_render = network_->run(truth.width, truth.height);

  double distance = 0;
  for (std::size_t m = 0; m < 2 * kTaps; m += 2) {
    distance += tap_distance(of_render[m], of_render[m + 1], of_truth[m], of_truth[m + 1]);
  }
  return distance;
}

}  // namespace splatboost
