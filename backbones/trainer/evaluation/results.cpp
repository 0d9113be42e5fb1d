// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/results.h"

#include <limits>

#include <nlohmann/json.hpp>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

using nlohmann::json;

template <class T>
concept Record = requires(T& record) {
  for_each_field(record, [](const char*, auto&, Presence) {});
};

// --- writing

template <class T>
json write(const T& value) {
  return value;
}

json write(const std::optional<double>& value) { return value ? json(*value) : json(nullptr); }

template <Record T>
json write(const std::vector<T>& records);

template <Record T>
json write(const T& record) {
  json object = json::object();
  for_each_field(record, [&](const char* name, const auto& field, Presence) { object[name] = write(field); });
  return object;
}

template <Record T>
json write(const std::vector<T>& records) {
  json array = json::array();
  for (const T& record : records) array.push_back(write(record));
  return array;
}

// --- reading; `place` names the value in messages

[[noreturn]] void fail(const std::string& place, const std::string& problem) {
  throw InputError("results: \"" + place + "\" " + problem + ".");
}

// JSON has no NaN: a number that is not finite is written as null, and read back as NaN.
void read(const json& value, const std::string& place, double& out) {
  if (!value.is_number() && !value.is_null()) fail(place, "must be a number");
  out = value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
}

void read(const json& value, const std::string& place, std::optional<double>& out) {
  if (!value.is_number() && !value.is_null()) fail(place, "must be a number or null");
  out = value.is_null() ? std::nullopt : std::optional(value.get<double>());
}

void read(const json& value, const std::string& place, std::string& out) {
  if (!value.is_string()) fail(place, "must be a string");
  out = value.get<std::string>();
}

void read(const json& value, const std::string& place, bool& out) {
  if (!value.is_boolean()) fail(place, "must be true or false");
  out = value.get<bool>();
}

void read(const json& value, const std::string& place, std::uint64_t& out) {
  if (!value.is_number_unsigned() && !(value.is_number_integer() && value.get<std::int64_t>() >= 0)) {
    fail(place, "must be a whole number of at least 0");
  }
  out = value.get<std::uint64_t>();
}

void read(const json& value, const std::string& place, int& out) {
  std::uint64_t number = 0;
  read(value, place, number);
  if (number > static_cast<std::uint64_t>(std::numeric_limits<int>::max())) fail(place, "is too large");
  out = static_cast<int>(number);
}

void read(const json& value, const std::string& place, std::map<std::string, double>& out) {
  if (!value.is_object()) fail(place, "must be an object");
  for (const auto& [key, number] : value.items()) read(number, place + "." + key, out[key]);
}

template <Record T>
void read(const json& array, const std::string& place, std::vector<T>& records);

template <Record T>
void read(const json& object, const std::string& place, T& record) {
  if (!object.is_object() && place.empty()) throw InputError("results: the file must be an object.");
  if (!object.is_object()) fail(place, "must be an object");
  for_each_field(record, [&](const char* name, auto& field, Presence presence) {
    const std::string inner = place.empty() ? name : place + "." + name;
    const auto found = object.find(name);
    if (found != object.end()) {
      read(*found, inner, field);
    } else if (presence == Presence::required) {
      fail(inner, "is missing");
    }
  });
}

template <Record T>
void read(const json& array, const std::string& place, std::vector<T>& records) {
  if (!array.is_array()) fail(place, "must be an array");
  for (std::size_t i = 0; i < array.size(); ++i) {
    read(array[i], place + "[" + std::to_string(i) + "]", records.emplace_back());
  }
}

json ratio(double boosted, double baseline) { return baseline != 0 ? json(boosted / baseline) : json(nullptr); }

json ratio(std::uint64_t boosted, std::uint64_t baseline) {
  return ratio(static_cast<double>(boosted), static_cast<double>(baseline));
}

}  // namespace

json to_json(const Results& results) { return write(results); }

Results results_from_json(const json& document) {
  Results results;
  read(document, "", results);
  return results;
}

std::optional<double> seconds_to_psnr(std::span<const CurvePoint> curve, double psnr) {
  const CurvePoint* before = nullptr;  // the last point that has a PSNR
  for (const CurvePoint& point : curve) {
    if (!point.psnr) continue;
    if (*point.psnr >= psnr) {
      if (before == nullptr) return point.seconds;
      const double share = (psnr - *before->psnr) / (*point.psnr - *before->psnr);
      return before->seconds + share * (point.seconds - before->seconds);
    }
    before = &point;
  }
  return std::nullopt;
}

json comparison_to_json(const Results& baseline, const Results& boosted) {
  json differences = {{"psnr", boosted.psnr - baseline.psnr},
                      {"psnr_beta1", boosted.psnr_beta1 - baseline.psnr_beta1},
                      {"ssim", boosted.ssim - baseline.ssim},
                      {"lpips", nullptr}};
  if (baseline.lpips && boosted.lpips) differences["lpips"] = *boosted.lpips - *baseline.lpips;
  return {{"baseline", to_json(baseline)},
          {"boosted", to_json(boosted)},
          {"ratios",
           {{"train_seconds", ratio(boosted.train_seconds, baseline.train_seconds)},
            {"speedup", ratio(baseline.train_seconds, boosted.train_seconds)},
            {"primitives", ratio(boosted.primitives, baseline.primitives)},
            {"storage_bytes", ratio(boosted.storage_bytes, baseline.storage_bytes)},
            {"peak_memory_bytes", ratio(boosted.peak_memory_bytes, baseline.peak_memory_bytes)},
            {"fps", ratio(boosted.fps, baseline.fps)}}},
          {"differences", std::move(differences)}};
}

}  // namespace splatboost
