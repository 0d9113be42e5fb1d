// SPDX-License-Identifier: Apache-2.0
/// @file A set of command-line options that settings files can set too.
#pragma once

#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "trainer/support/json_values.h"

namespace splatboost::program {

template <class T>
struct OptionValue {
  using type = T;
};
template <class T>
struct OptionValue<std::optional<T>> : OptionValue<T> {};
template <class T>
struct OptionValue<std::vector<T>> : OptionValue<T> {};

/// Describes what is wrong with the text of an option; empty if nothing is. Without this check, the parser would take
/// an empty text (an unset shell variable) for an absent option, -1 and numbers out of range for the largest number,
/// and 010 for an octal number.
/// @tparam T type of a single value
template <class T>
std::string wrong_text(const std::string& text) {
  if (text.empty()) return "is empty; leave the option out, or give it a value";
  if constexpr (std::is_arithmetic_v<T>) {
    if (std::unsigned_integral<T> && text[0] == '-') return "must be at least 0";
    T value{};
    const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
    const bool whole = parsed.ptr == text.data() + text.size();
    if (parsed.ec == std::errc::result_out_of_range) return "'" + text + "' is out of range";
    bool good = parsed.ec == std::errc{} && whole;
    if constexpr (std::floating_point<T>) good = good && std::isfinite(value);
    if (!good) return "'" + text + "' is not a " + (std::floating_point<T> ? "number" : "whole number");
    if constexpr (std::integral<T>) {
      if (text != std::to_string(value)) return "'" + text + "' must not begin with 0";
    }
  }
  return {};
}

/// Adds an option whose text is checked by wrong_text() before it is parsed.
template <class T>
CLI::Option* add_checked_option(CLI::App& app, const std::string& names, T& value, const std::string& help) {
  return app.add_option(names, value, help)->check(CLI::Validator(wrong_text<typename OptionValue<T>::type>, ""));
}

/// Options that a JSON file can also set, by their long names. The command line overrides the file.
class OptionSet {
 public:
  /// Options join the app's help under the current group.
  explicit OptionSet(CLI::App& app) : app_(&app) {}

  void set_group(std::string group) { group_ = std::move(group); }
  /// Options added from here on can be set by files only: those of another subcommand whose files this one reads.
  void files_only() { app_ = &unseen_; }

  /// @param recorded whether config.json of a run holds it
  template <class T>
  CLI::Option* add(const std::string& names, T& value, const std::string& help, bool recorded = true) {
    CLI::Option* option = nullptr;
    if constexpr (std::same_as<T, bool>) {
      // Otherwise the last of --boost --no-boost would count.
      option = app_->add_flag(names, value, help)->multi_option_policy(CLI::MultiOptionPolicy::Throw);
    } else {
      option = add_checked_option(*app_, names, value, help);
    }
    option->group(group_);
    Entry entry;
    entry.option = option;
    entry.name = option->get_lnames().front();
    entry.recorded = recorded;
    entry.read = [&value](const nlohmann::json& json, const std::string& place, bool sets) {
      T read{};
      read_value(json, place, read);
      if (sets) value = std::move(read);
    };
    entry.write = [&value] { return to_record(value); };
    entries_.push_back(std::move(entry));
    return option;
  }

  /// Sets the options that the command line does not give from a file's JSON object. Keys in `reserved` are skipped;
  /// any other unknown key throws InputError, as does a value of the wrong type, also of an option that is given.
  void overlay(const nlohmann::json& object, const std::string& place, const std::set<std::string>& reserved);

  /// Throws unless `holds`: InputError with the place if a file gave the option's value, otherwise UsageError.
  /// @param name of the option, without dashes @param rule what must hold: "must be at least 1"
  void check(bool holds, const std::string& name, const std::string& rule) const;

  /// Values of the recorded options, without empty ones and with absolute paths. Throws InputError on a path that is
  /// not UTF-8, which JSON cannot hold.
  nlohmann::json record() const;

  bool given(const std::string& name) const;
  /// The first option of this group of the help that the command line gives; empty: none.
  std::string given_of(const std::string& group) const;

 private:
  struct Entry {
    CLI::Option* option = nullptr;
    std::string name;
    bool recorded = true;
    std::string place;  ///< in a file that gave the value; empty: none did
    std::function<void(const nlohmann::json&, const std::string& place, bool sets)> read;
    std::function<nlohmann::json()> write;
  };

  template <class T>
  static nlohmann::json to_record(const T& value) {
    return value;
  }
  template <class T>
  static nlohmann::json to_record(const std::optional<T>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
  }
  static nlohmann::json to_record(const std::filesystem::path& value);

  CLI::App* app_;
  CLI::App unseen_;
  std::string group_ = "Options";
  std::vector<Entry> entries_;
};

}  // namespace splatboost::program
