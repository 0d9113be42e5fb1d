// SPDX-License-Identifier: Apache-2.0
/// @file The measured results of a run: results.json.
#pragma once

#include <concepts>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace splatboost {

struct ViewResult {
  std::string name;
  double psnr = 0;
  double ssim = 0;
  std::optional<double> lpips;
};

/// Quality at one of the scales, means over the measured views.
struct ScaleResult {
  int divisor = 1;  ///< of the trained resolution
  double psnr = 0;
  double ssim = 0;
};

/// A point of the training curves.
struct CurvePoint {
  int iteration = 0;
  double seconds = 0;  ///< training time so far, evaluation excluded
  double loss = 0;     ///< exponential mean of the training loss
  std::size_t primitives = 0;
  std::optional<double> psnr;  ///< over a few test views; none if not evaluated at this point
};

/// Training seconds until the curve first reaches `psnr` (dB), interpolated linearly between points; none if it never
/// does.
std::optional<double> seconds_to_psnr(std::span<const CurvePoint> curve, double psnr);

struct Results {
  std::string backbone;
  bool boost = false;
  int iterations = 0;
  double psnr = 0;
  double ssim = 0;
  std::optional<double> lpips;
  double psnr_beta1 = 0;  ///< PSNR in a viewer without the compact box
  std::string split;      ///< "test" or "train": which views were measured
  std::size_t primitives = 0;
  double train_seconds = 0;  ///< wall time of the loop, evaluation and saving excluded
  double fps = 0;            ///< frames per second when rendering the measured views
  std::uint64_t peak_memory_bytes = 0;
  std::uint64_t estimated_memory_bytes = 0;  ///< estimated before training, for the largest number of primitives
  std::uint64_t storage_bytes = 0;           ///< of the exported model
  std::string device;                        ///< "cpu", or the name of the GPU
  std::string machine;                       ///< processor name
  int threads = 0;
  std::uint64_t seed = 0;
  std::string version;
  std::string command;        ///< the command line
  std::string date;           ///< ISO 8601, UTC
  std::string source;         ///< name of the scene folder
  int width = 0, height = 0;  ///< of the first training view
  std::vector<ViewResult> views;
  std::vector<ScaleResult> scales;  ///< the trained scale first
  std::map<std::string, double> stage_seconds;
  std::vector<CurvePoint> curve;
};

/// Whether a field is required when results.json is read: earlier versions did not write all fields.
enum class Presence { required, may_lack };

/// Calls visit(name, field, presence) for every field.
template <class R, class Visit>
requires std::same_as<std::remove_const_t<R>, ViewResult>
void for_each_field(R& r, Visit&& visit) {
  visit("name", r.name, Presence::required);
  visit("psnr", r.psnr, Presence::required);
  visit("ssim", r.ssim, Presence::required);
  visit("lpips", r.lpips, Presence::required);
}

/// Calls visit(name, field, presence) for every field.
template <class R, class Visit>
requires std::same_as<std::remove_const_t<R>, ScaleResult>
void for_each_field(R& r, Visit&& visit) {
  visit("divisor", r.divisor, Presence::required);
  visit("psnr", r.psnr, Presence::required);
  visit("ssim", r.ssim, Presence::required);
}

/// Calls visit(name, field, presence) for every field.
template <class R, class Visit>
requires std::same_as<std::remove_const_t<R>, CurvePoint>
void for_each_field(R& r, Visit&& visit) {
  visit("iteration", r.iteration, Presence::required);
  visit("seconds", r.seconds, Presence::required);
  visit("loss", r.loss, Presence::required);
  visit("primitives", r.primitives, Presence::required);
  visit("psnr", r.psnr, Presence::required);
}

/// Calls visit(name, field, presence) for every field.
template <class R, class Visit>
requires std::same_as<std::remove_const_t<R>, Results>
void for_each_field(R& r, Visit&& visit) {
  visit("backbone", r.backbone, Presence::required);
  visit("boost", r.boost, Presence::required);
  visit("iterations", r.iterations, Presence::required);
  visit("psnr", r.psnr, Presence::required);
  visit("ssim", r.ssim, Presence::required);
  visit("lpips", r.lpips, Presence::required);
  visit("psnr_beta1", r.psnr_beta1, Presence::required);
  visit("split", r.split, Presence::may_lack);
  visit("primitives", r.primitives, Presence::required);
  visit("train_seconds", r.train_seconds, Presence::required);
  visit("fps", r.fps, Presence::required);
  visit("peak_memory_bytes", r.peak_memory_bytes, Presence::required);
  visit("estimated_memory_bytes", r.estimated_memory_bytes, Presence::may_lack);
  visit("storage_bytes", r.storage_bytes, Presence::required);
  visit("device", r.device, Presence::required);
  visit("machine", r.machine, Presence::may_lack);
  visit("threads", r.threads, Presence::required);
  visit("seed", r.seed, Presence::required);
  visit("version", r.version, Presence::required);
  visit("command", r.command, Presence::may_lack);
  visit("date", r.date, Presence::may_lack);
  visit("source", r.source, Presence::may_lack);
  visit("width", r.width, Presence::may_lack);
  visit("height", r.height, Presence::may_lack);
  visit("views", r.views, Presence::required);
  visit("scales", r.scales, Presence::may_lack);
  visit("stage_seconds", r.stage_seconds, Presence::required);
  visit("curve", r.curve, Presence::may_lack);
}

nlohmann::json to_json(const Results& results);
/// Throws InputError if a required key is missing.
Results results_from_json(const nlohmann::json& json);

/// compare.json: {"baseline", "boosted", "ratios": boosted / baseline of time ("speedup": its inverse), primitives,
/// storage, memory and fps, "differences": boosted − baseline of PSNR, SSIM, LPIPS}. Null where a value is missing or
/// the baseline is 0.
nlohmann::json comparison_to_json(const Results& baseline, const Results& boosted);

}  // namespace splatboost
