// SPDX-License-Identifier: Apache-2.0
#include "trainer/report/report_pictures.h"

#include <algorithm>
#include <cstdio>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace splatboost {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxSide = 960;  // of an embedded picture: sharp when enlarged, but pages stay at a few MB
constexpr int kErrorMap = cv::COLORMAP_INFERNO;

cv::Mat read_picture(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return {};  // otherwise OpenCV prints a warning
  return cv::imread(path.string(), cv::IMREAD_COLOR);
}

cv::Mat shrink(const cv::Mat& picture) {
  const int longest = std::max(picture.cols, picture.rows);
  if (longest <= kMaxSide) return picture;
  const double scale = static_cast<double>(kMaxSide) / longest;
  cv::Mat out;
  cv::resize(picture, out, {}, scale, scale, cv::INTER_AREA);
  return out;
}

ReportPicture encode(const cv::Mat& picture) {
  ReportPicture out{picture.cols, picture.rows, {}};
  cv::imencode(".jpg", picture, out.jpeg, {cv::IMWRITE_JPEG_QUALITY, 90});
  return out;
}

}  // namespace

ReportPicture report_picture(const fs::path& path) {
  const cv::Mat picture = read_picture(path);
  return picture.empty() ? ReportPicture{} : encode(shrink(picture));
}

ReportPicture report_depth_picture(const fs::path& path) {
  const cv::Mat picture = read_picture(path);
  if (picture.empty()) return {};
  cv::Mat colored;
  cv::applyColorMap(shrink(picture), colored, kErrorMap);
  return encode(colored);
}

ReportPicture report_error_picture(const fs::path& render, const fs::path& truth) {
  const cv::Mat a = read_picture(render), b = read_picture(truth);
  if (a.empty() || a.size() != b.size()) return {};
  cv::Mat difference, mean, bytes, colored;
  cv::absdiff(a, b, difference);
  difference.convertTo(difference, CV_32F);
  cv::transform(difference, mean, cv::Matx13f(1 / 3.0f, 1 / 3.0f, 1 / 3.0f));
  // Shrink before applying the colour map: averaging errors is meaningful, averaging colours is not.
  shrink(mean).convertTo(bytes, CV_8U, kReportErrorGain);
  cv::applyColorMap(bytes, colored, kErrorMap);
  return encode(colored);
}

std::string report_error_colors() {
  cv::Mat ramp(1, 9, CV_8U), colors;
  for (int i = 0; i < ramp.cols; ++i) ramp.at<std::uint8_t>(0, i) = static_cast<std::uint8_t>(std::min(255, i * 32));
  cv::applyColorMap(ramp, colors, kErrorMap);
  std::string stops;
  for (int i = 0; i < colors.cols; ++i) {
    const cv::Vec3b bgr = colors.at<cv::Vec3b>(0, i);
    char text[32];
    std::snprintf(text, sizeof text, ",#%02x%02x%02x", bgr[2], bgr[1], bgr[0]);
    stops += text;
  }
  return stops;
}

}  // namespace splatboost
