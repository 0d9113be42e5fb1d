// SPDX-License-Identifier: Apache-2.0
#include "program/run_program.h"

#include <malloc.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "program/command_line/help.h"
#include "program/command_line/suggest.h"
#include "program/commands/commands.h"
#include "program/session/run_options.h"
#include "splatboost/errors.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

constexpr int kFailure = 1;
constexpr int kUsage = 2;

/// Joins the lines of a message, which may come from a library, into one line.
std::string one_line(std::string_view text) {
  std::string line;
  for (const char c : text) {
    const bool blank = c == '\n' || c == '\r' || c == '\t' || c == ' ';
    if (!blank) {
      line += c;
    } else if (!line.empty() && line.back() != ' ') {
      line += ' ';
    }
  }
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return printable(line);
}

/// Shortens a message to a readable length: a damaged file may contain a name of a megabyte. The end is kept because it
/// says what to do.
std::string shortened(const std::string& line) {
  constexpr std::size_t kBegin = 700;
  constexpr std::size_t kEnd = 300;
  if (line.size() <= kBegin + kEnd) return line;
  const auto starts_character = [&](std::size_t at) { return (static_cast<unsigned char>(line[at]) & 0xc0) != 0x80; };
  std::size_t end = kBegin;
  while (!starts_character(end)) --end;
  std::size_t begin = line.size() - kEnd;
  while (!starts_character(begin)) ++begin;
  return line.substr(0, end) + " … " + line.substr(begin);
}

int fail(int code, std::string_view where, std::string_view what) {
  std::fprintf(stderr, "%s: %s\n", std::string(where).c_str(), shortened(one_line(what)).c_str());
  return code;
}

/// Python trainers spell options with underscores; both spellings are accepted.
std::string with_dashes(std::string argument) {
  if (argument.size() < 3 || argument.compare(0, 2, "--") != 0) return argument;
  for (std::size_t i = 2; i < argument.size() && argument[i] != '='; ++i) {
    if (argument[i] == '_') argument[i] = '-';
  }
  return argument;
}

std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

std::string unknown_argument(const std::string& argument, const CLI::App& app) {
  if (argument.size() > 1 && argument[0] == '-') {
    const std::string name = argument.substr(0, argument.find('='));
    if (app.get_option_no_throw(name) != nullptr) return name + " must come after the command";
    return "unknown option " + name + did_you_mean(name, option_names(app));
  }
  std::vector<std::string> commands;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    commands.push_back(command->get_name());
  }
  if (!commands.empty()) return "unknown command '" + argument + "'" + did_you_mean(argument, commands);
  return "'" + argument + "' is not expected here; options start with --";
}

/// How to use less memory, if the command has an option for it.
std::string memory_advice(const std::vector<CLI::App*>& chosen) {
  std::string advice;
  for (const auto& [option, change] : {std::pair("--resolution", "lower"), std::pair("--max-primitives", "set")}) {
    if (chosen.empty() || chosen.front()->get_option_no_throw(option) == nullptr) continue;
    advice += std::string(advice.empty() ? ": " : " or ") + change + " " + option;
  }
  return advice;
}

int run_commands(int argc, char** argv) {
  CLI::App program("SplatBoost trains 3D Gaussian Splatting faster, with fewer Gaussians.", "splatboost");
  program.formatter(std::make_shared<HelpFormatter>());
  program.set_help_flag("-h,--help", "print this and exit");
  program.set_version_flag("--version", "splatboost " SPLATBOOST_VERSION, "print the version and exit");
  program.footer("See splatboost COMMAND --help for the options of a command.");
  const std::vector<Command> commands = {
      add_train(program),     add_compare(program), add_render(program), add_eval(program), add_mesh(program),
      add_mesh_eval(program), add_slam(program),    add_synth(program),  add_pack(program), add_points(program),
      add_export(program),    add_bench(program),   add_patch(program)};
  // Unknown commands and options are reported below, with a suggestion, and so is a second command.
  program.allow_extras();
  program.require_subcommand(0, 1);
  for (const Command& command : commands) {
    command.app->allow_extras();
    command.app->group("Commands");
  }

  std::string command_line = "splatboost";
  std::vector<std::string> arguments;
  for (int i = 1; i < argc; ++i) {
    command_line += " " + shell_word(argv[i]);
    arguments.insert(arguments.begin(), with_dashes(argv[i]));  // CLI11 expects them in reverse order
  }
  std::string where = "splatboost";
  const auto help_hint = [&where] { return " (see " + where + " --help)"; };
  try {
    for (const std::string& argument : arguments) {
      if (!is_utf8(argument)) throw UsageError("'" + argument + "' is not UTF-8; rename the file or the folder");
    }
    try {
      program.parse(arguments);
    } catch (const CLI::Success& asked) {  // --help, --version
      return program.exit(asked);
    } catch (const CLI::ParseError& error) {
      if (!program.get_subcommands().empty()) where += " " + program.get_subcommands().front()->get_name();
      const std::string_view message = error.what();
      constexpr std::string_view kConversion = "Could not convert: ";
      if (message.substr(0, kConversion.size()) == kConversion) {
        throw UsageError("value not understood: " + std::string(message.substr(kConversion.size())));
      }
      if (const std::size_t twice = message.find(": At Most 1 required"); twice != std::string_view::npos) {
        throw UsageError(std::string(message.substr(0, twice)) + " is given more than once");
      }
      throw UsageError(error.what());
    }
    const std::vector<CLI::App*> chosen = program.get_subcommands();
    if (chosen.empty()) {
      std::vector<std::string> names;
      std::string list;
      for (const Command& command : commands) {
        names.push_back(command.app->get_name());
        list += (list.empty() ? "" : ", ") + names.back();
      }
      const std::vector<std::string> rest = program.remaining();
      if (rest.empty()) throw UsageError("no command given; available: " + list);
      if (rest[0][0] == '-') throw UsageError(unknown_argument(rest[0], program));
      const std::string nearest = did_you_mean(rest[0], names);
      throw UsageError("unknown command '" + rest[0] + "'" + (nearest.empty() ? "; available: " + list : nearest));
    }
    where += " " + chosen.front()->get_name();
    const std::vector<std::string> rest = program.remaining(true);
    if (!rest.empty()) {
      const CLI::App* command = chosen.front();
      const std::vector<CLI::App*> deeper = command->get_subcommands();
      if (!deeper.empty()) {
        where += " " + deeper.front()->get_name();
        command = deeper.front();
      }
      if (std::ranges::any_of(commands, [&](const Command& other) { return other.app->get_name() == rest[0]; })) {
        throw UsageError("only one command can be given: " + rest[0] + " stands after " + chosen.front()->get_name());
      }
      throw UsageError(unknown_argument(rest[0], *command));
    }
    for (const Command& command : commands) {
      if (command.app == chosen.front()) return command.run(command_line);
    }
    return kFailure;
  } catch (const UsageError& error) {
    return fail(kUsage, where, error.what() + help_hint());
  } catch (const InputError& error) {
    return fail(kUsage, where, error.what());
  } catch (const ArgumentError& error) {
    return fail(kUsage, where, error.what());
  } catch (const NoDeviceError& error) {
    return fail(kUsage, where, error.what());
  } catch (const std::bad_alloc&) {
    return fail(kFailure, where, "out of memory" + memory_advice(program.get_subcommands()));
  } catch (const DeviceMemoryError& error) {
    return fail(kFailure, where, std::string(error.what()) + "; use --device cpu to run without a GPU");
  } catch (const std::filesystem::filesystem_error& error) {
    return fail(kFailure, where, error.path1().string() + ": " + error.code().message());
  } catch (const std::exception& error) {
    return fail(kFailure, where, error.what());
  }
}

/// Output is buffered, so failed writes are known only at the end.
int finish_output(int code) {
  std::cout.flush();
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0 && std::cout.good()) return code;
  // errno is no longer that of the failed write, which may have been long ago.
  return code != 0 ? code : fail(kFailure, "splatboost", "cannot write to standard output; the disk may be full");
}

}  // namespace

int run_program(int argc, char** argv) {
  // Makes a write beyond the file size limit fail like one on a full disk, so that it is reported.
  std::signal(SIGXFSZ, SIG_IGN);
  // Memory of arrays above this size then returns to the system when they are freed. By default the limit rises to that
  // of the largest freed array, and the heap keeps pages between smaller ones, which the second run of a comparison
  // would count as its own.
  mallopt(M_MMAP_THRESHOLD, 1 << 20);
  return finish_output(run_commands(argc, argv));
}

}  // namespace splatboost::program
