// SPDX-License-Identifier: Apache-2.0
// lpips_distance NETWORK.onnx RENDER.png TRUTH.png [RENDER.png TRUTH.png …] [--mask MASK.png]
// Prints the LPIPS of each pair, one per line, as the program computes it. For tests/scripts/test_lpips.py.
// A mask (non-zero = valid) applies to every pair.
#include <cstdint>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/imgcodecs.hpp>

#include "trainer/evaluation/metrics.h"
#include "trainer/support/input_error.h"

namespace {

cv::Mat read(const std::string& path, int mode) {
  const cv::Mat image = cv::imread(path, mode);
  if (image.empty()) throw splatboost::InputError("cannot read " + path);
  return image;
}

// Planar RGB, the project's layout; OpenCV reads interleaved BGR.
std::vector<std::uint8_t> read_planar(const std::string& path, int& width, int& height) {
  const cv::Mat image = read(path, cv::IMREAD_COLOR);
  width = image.cols;
  height = image.rows;
  std::vector<std::uint8_t> planar;
  planar.reserve(image.total() * 3);
  for (int c = 2; c >= 0; --c) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) planar.push_back(image.at<cv::Vec3b>(y, x)[c]);
    }
  }
  return planar;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    std::vector<std::string> paths;
    std::vector<std::uint8_t> valid;
    for (int i = 1; i < argc; ++i) {
      if (std::string(argv[i]) == "--mask" && i + 1 < argc) {
        const cv::Mat mask = read(argv[++i], cv::IMREAD_GRAYSCALE);
        valid.assign(mask.begin<std::uint8_t>(), mask.end<std::uint8_t>());
      } else {
        paths.emplace_back(argv[i]);
      }
    }
    if (paths.size() < 3 || paths.size() % 2 == 0) {
      throw splatboost::InputError("usage: lpips_distance NETWORK.onnx RENDER.png TRUTH.png … [--mask MASK.png]");
    }
    splatboost::Lpips lpips(paths[0]);
    for (std::size_t i = 1; i < paths.size(); i += 2) {
      splatboost::TruthImage truth;
      int width = 0, height = 0;
      const std::vector<std::uint8_t> bytes = read_planar(paths[i], width, height);
      const std::vector<std::uint8_t> color = read_planar(paths[i + 1], truth.width, truth.height);
      std::vector<float> render;
      for (const std::uint8_t byte : bytes) render.push_back(static_cast<float>(byte) / 255.0f);
      truth.color = color;
      truth.valid = valid;
      std::printf("%.9g\n", lpips.distance(render, truth));
    }
    return 0;
  } catch (const splatboost::InputError& error) {
    std::fprintf(stderr, "lpips_distance: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "lpips_distance: %s\n", error.what());
    return 1;
  }
}
