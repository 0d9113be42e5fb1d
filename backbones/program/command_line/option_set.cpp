// SPDX-License-Identifier: Apache-2.0
#include "program/command_line/option_set.h"

#include <algorithm>

#include "program/command_line/suggest.h"
#include "program/session/run_options.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"

namespace splatboost::program {

using Json = nlohmann::json;

Json OptionSet::to_record(const std::filesystem::path& value) {
  if (value.empty()) return nullptr;
  const std::string path = std::filesystem::absolute(value).lexically_normal().string();
  require(is_utf8(path), path + ": this path is not UTF-8 and cannot be written into config.json; rename it");
  return path;
}

void OptionSet::overlay(const Json& object, const std::string& place, const std::set<std::string>& reserved) {
  std::vector<std::string> names;
  for (const Entry& entry : entries_) names.push_back(entry.name);
  for (const auto& item : object.items()) {
    if (reserved.count(item.key()) != 0) continue;
    const auto entry =
        std::find_if(entries_.begin(), entries_.end(), [&](const Entry& e) { return e.name == item.key(); });
    if (entry == entries_.end()) {
      names.insert(names.end(), reserved.begin(), reserved.end());
      throw InputError(place + ": unknown key '" + item.key() + "'" + did_you_mean(item.key(), names));
    }
    const bool sets = entry->option->count() == 0;
    entry->read(item.value(), place + ": " + item.key(), sets);
    if (sets) entry->place = place + ": " + item.key();
  }
}

void OptionSet::check(bool holds, const std::string& name, const std::string& rule) const {
  if (holds) return;
  const auto entry = std::ranges::find(entries_, name, &Entry::name);
  if (entry != entries_.end() && !entry->place.empty()) throw InputError(entry->place + " " + rule);
  throw UsageError("--" + name + " " + rule);
}

Json OptionSet::record() const {
  Json object = Json::object();
  for (const Entry& entry : entries_) {
    if (!entry.recorded) continue;
    Json value = entry.write();
    if (!value.is_null() && !(value.is_array() && value.empty())) object[entry.name] = std::move(value);
  }
  return object;
}

bool OptionSet::given(const std::string& name) const {
  return std::any_of(entries_.begin(), entries_.end(),
                     [&](const Entry& entry) { return entry.name == name && entry.option->count() > 0; });
}

std::string OptionSet::given_of(const std::string& group) const {
  const auto entry = std::ranges::find_if(entries_, [&](const Entry& candidate) {
    return candidate.option->get_group() == group && candidate.option->count() > 0;
  });
  return entry == entries_.end() ? "" : entry->name;
}

}  // namespace splatboost::program
