// SPDX-License-Identifier: Apache-2.0
/// @file Formatting of --help.
#pragma once

#include <string>

#include <CLI/CLI.hpp>

namespace splatboost::program {

/// "-r,--resolution N   what it does [default]", with one blank line between groups.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter();
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override;
  std::string make_option_name(const CLI::Option* option, bool is_positional) const override;
  std::string make_option_opts(const CLI::Option* option) const override;
  std::string make_option_desc(const CLI::Option* option) const override;
};

}  // namespace splatboost::program
