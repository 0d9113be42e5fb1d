// SPDX-License-Identifier: Apache-2.0
/// @file The settings of any adapter by name. Each adapter has one struct of settings with one for_each_field(), which
/// visits them by name, and one check(). JSON, the command line, the C ABI and Python are derived from these.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "registry/adapter.h"
#include "splatboost/device.h"
#include "splatboost/errors.h"

namespace splatboost {

/// For check(): throws ArgumentError with this reason.
inline void check_setting(bool holds, const char* reason) {
  if (!holds) throw ArgumentError(reason);
}

/// Points that an in-tree trainer adds to those of the dataset, triangulated from the photos, before it starts.
enum class AddedPoints {
  none,
  tracked,  ///< those of features that several photos share
  gaps,     ///< these, and where photos show none
};

/// The settings of an accelerated run, whatever the backbone.
class BoostSettings {
 public:
  struct Setting {
    const char* name;  ///< lives as long as the program
    std::variant<bool*, int*, float*, double*> value;
  };

  virtual ~BoostSettings() = default;
  /// All settings in the order of their struct. The pointers live as long as this object.
  virtual std::vector<Setting> settings() = 0;
  /// Throws ArgumentError, naming the setting, if a value is out of range.
  virtual void validate() const = 0;
  /// Share of the run, from its start, for which an in-tree trainer uses half-size views; 0: none.
  virtual double coarse_share() const = 0;
  virtual AddedPoints added_points() const = 0;
  /// Whether an in-tree trainer scales the lengths in the backbone's settings to the scene, where these have
  /// absolute_distances.
  virtual bool scales_lengths() const = 0;
  /// @param device where the backbone trains
  virtual std::unique_ptr<Adapter> make_adapter(std::uint64_t seed, Device device) const = 0;
};

/// @tparam AdapterType constructed from (Boost, Device) @tparam Boost its struct of settings
template <class AdapterType, class Boost>
class SettingsOf final : public BoostSettings {
 public:
  explicit SettingsOf(const Boost& boost) : boost_(boost) {}

  std::vector<Setting> settings() override {
    std::vector<Setting> all;
    for_each_field(boost_, [&](const char* name, auto& value) { all.push_back({name, &value}); });
    return all;
  }
  void validate() const override { check(boost_); }
  double coarse_share() const override { return boost_.coarse ? boost_.coarse_until : 0; }
  AddedPoints added_points() const override {
    if constexpr (requires { boost_.fill_gaps; }) return boost_.fill_gaps ? AddedPoints::gaps : AddedPoints::none;
    if constexpr (requires { boost_.track_points; }) {
      return boost_.track_points ? AddedPoints::tracked : AddedPoints::none;
    }
    return AddedPoints::none;
  }
  bool scales_lengths() const override {
    if constexpr (requires { boost_.scale_lengths; }) return boost_.scale_lengths;
    return false;
  }
  std::unique_ptr<Adapter> make_adapter(std::uint64_t seed, Device device) const override {
    Boost boost = boost_;
    boost.seed = seed;
    return std::make_unique<AdapterType>(boost, device);
  }

 private:
  Boost boost_;
};

template <class AdapterType, class Boost>
std::unique_ptr<BoostSettings> make_settings(const Boost& boost) {
  return std::make_unique<SettingsOf<AdapterType, Boost>>(boost);
}

/// The acceleration of one backbone. Each folder of adapters/ defines one: `AdapterEntry NAME_adapter_entry()`.
struct AdapterEntry {
  std::string_view backbone;  ///< its name for --backbone
  /// @param literal the paper's exact rules and numbers instead of the defaults
  std::unique_ptr<BoostSettings> (*make_settings)(bool literal);
};

/// One for each folder of adapters/ that CMake found.
const std::vector<AdapterEntry>& adapters();

/// The entry of a backbone. Throws ArgumentError, listing the known backbones, if there is none.
const AdapterEntry& find_adapter(std::string_view backbone);

}  // namespace splatboost
