// SPDX-License-Identifier: Apache-2.0
#include "program/command_line/help.h"

namespace splatboost::program {
namespace {

/// Replaces from left to right. Inserted text is searched again, so that runs collapse, unless it contains `what`.
void replace_all(std::string& text, const std::string& what, const std::string& by) {
  const std::size_t skip = by.find(what) == std::string::npos ? 0 : by.size();
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + skip)) {
    text.replace(at, what.size(), by);
  }
}

constexpr std::size_t kColumn = 32, kLine = 120;

/// Wraps descriptions that are longer than a line.
std::string wrapped(std::string text) {
  constexpr std::size_t kWidth = kLine - kColumn;
  for (std::size_t begin = 0; text.size() - begin > kWidth;) {
    const std::size_t space = text.rfind(' ', begin + kWidth);
    if (space == std::string::npos || space <= begin) break;
    text[space] = '\n';
    begin = space + 1;
  }
  return text;
}

}  // namespace

HelpFormatter::HelpFormatter() {
  column_width(kColumn);
  label("SUBCOMMAND", "COMMAND");
}

std::string HelpFormatter::make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const {
  std::string help = CLI::Formatter::make_help(app, std::move(name), mode);
  replace_all(help, "\n\n\n", "\n\n");  // CLI11 puts two between groups
  return help;
}

std::string HelpFormatter::make_option_name(const CLI::Option* option, bool is_positional) const {
  std::string name = CLI::Formatter::make_option_name(option, is_positional);
  replace_all(name, "{false}", "");  // how CLI11 marks the negative of a flag
  replace_all(name, ",", ", ");
  return name;
}

std::string HelpFormatter::make_option_opts(const CLI::Option* option) const {
  return option->get_type_size() == 0 ? "" : " " + option->get_type_name();
}

std::string HelpFormatter::make_option_desc(const CLI::Option* option) const {
  const std::string value = option->get_default_str();
  return wrapped(CLI::Formatter::make_option_desc(option) + (value.empty() ? "" : " [" + value + "]"));
}

}  // namespace splatboost::program
