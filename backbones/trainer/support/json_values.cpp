// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/json_values.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <iterator>
#include <set>
#include <utility>
#include <vector>

namespace splatboost {

using Json = nlohmann::json;

Json parse_json(std::string_view text, const std::string& place) {
  // Copying and writing JSON recurse once per level, so that a deeper document could overflow the stack. None of our
  // documents has more than five levels.
  constexpr int kDeepest = 64;
  std::vector<std::set<std::string>> keys;  // of the objects around the current place
  const auto check = [&](int depth, Json::parse_event_t event, Json& parsed) {
    if (depth > kDeepest) {
      throw InputError(place + ": is nested deeper than " + std::to_string(kDeepest) + " levels");
    }
    if (event == Json::parse_event_t::object_start) keys.emplace_back();
    if (event == Json::parse_event_t::object_end) keys.pop_back();
    // The parser would keep the last of the two values, without a sign.
    if (event == Json::parse_event_t::key) {
      const auto& key = parsed.get_ref<const std::string&>();
      require(keys.back().insert(key).second, place + ": the key '" + key + "' occurs twice");
    }
    return true;
  };
  try {
    return Json::parse(text, check, true, true);
  } catch (const Json::exception& error) {
    // Drops the prefix of "[json.exception.parse_error.101] parse error at line 1, column 2: …".
    std::string what = error.what();
    if (const auto bracket = what.find("] "); bracket != std::string::npos) what.erase(0, bracket + 2);
    constexpr int kNumberOverflow = 406;
    throw InputError(place + (error.id == kNumberOverflow ? ": a number is out of range: " : ": not JSON: ") + what);
  }
}

Json read_json_file(const std::filesystem::path& path) {
  std::error_code ignored;
  std::ifstream stream(path, std::ios::binary);
  if (!stream || std::filesystem::is_directory(path, ignored)) {
    throw InputError(path.string() + ": no such file, or it cannot be opened");
  }
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  if (stream.bad()) throw InputError(path.string() + ": cannot be read to its end");
  Json document = parse_json(text, path.string());
  if (!document.is_object()) throw InputError(path.string() + ": must hold a JSON object");
  return document;
}

void require_earlier_output(const std::filesystem::path& file, const std::vector<std::string>& keys,
                            const std::string& command) {
  std::error_code error;
  if (!std::filesystem::exists(file, error) || std::filesystem::is_empty(file, error)) return;
  bool ours = false;
  try {
    const Json document = read_json_file(file);
    ours = std::ranges::all_of(keys, [&](const std::string& key) { return document.contains(key); });
  } catch (const InputError&) {
  }
  require(ours, file.string() + ": exists and was not written by " + command + "; name another file");
}

nlohmann::json readable(float value) {
  std::array<char, 32> text{};
  const auto written = std::to_chars(text.data(), text.data() + text.size(), value);
  double decimal = value;
  std::from_chars(text.data(), written.ptr, decimal);
  return decimal;
}

}  // namespace splatboost
