// SPDX-License-Identifier: Apache-2.0
/// @file As much of a file's structure as edits and checks of a host need: statements of Python, C++ and CMake, and of
/// Python functions, calls and names too. Nothing is run; what is no valid code gives some answer and never fails.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace splatboost::patch {

enum class Language {
  python,
  cpp,   ///< and CUDA
  other  ///< comments, brackets and strings as in Python, such as CMake
};

/// By the ending of a file's name.
Language language_of(const std::string& file);

/// A statement: one line, or several joined by brackets, backslashes or a string over several lines. In C++ lines are
/// joined up to a semicolon or a brace, which end a statement where they end a line: a function's head is one
/// statement, and so is each of its body's.
struct Statement {
  std::size_t begin = 0;  ///< of its first line
  std::size_t end = 0;    ///< past its last character, before the line end
  int line = 1;           ///< of its begin
  int indent = 0;         ///< characters before the first one that is no space; meaningless where `empty`
  bool empty = true;      ///< nothing but space and comments
};

struct Parameter {
  std::string name;  ///< without stars
  bool optional = false;
  bool star = false;  ///< *name or **name
};

struct Function {
  std::string name;
  std::vector<Parameter> parameters;
  std::size_t statement = 0;
  std::size_t last = 0;  ///< its last statement
};

struct Call {
  std::vector<std::string> positional;  ///< texts of the arguments
  std::vector<std::string> keywords;    ///< names
  bool unpacked = false;                ///< has *… or **…
  int results = 0;                      ///< names that the statement assigns them to; 0: not assigned as they come
  std::size_t statement = 0;
};

class SourceCode {
 public:
  explicit SourceCode(std::string text, Language language = Language::python);

  const std::string& text() const { return text_; }
  const std::vector<Statement>& statements() const { return statements_; }
  /// The statement that holds a place of the text.
  std::size_t statement_at(std::size_t place) const;
  /// A statement in one line, without comments and double spaces, shortened.
  std::string show(std::size_t statement) const;
  /// The text with comments and the insides of strings blanked out.
  const std::string& code() const { return code_; }

  // Of Python.
  std::vector<Function> functions(const std::string& name) const;
  /// Calls of `name` or `a.name`, as it is written.
  std::vector<Call> calls(const std::string& name) const;

  /// Names that the statements read and do not set themselves.
  std::vector<std::string> names_used(std::size_t first_statement, std::size_t last_statement) const;
  /// Whether a name may be known where a statement stands: in a function around it, above, or anywhere at the top.
  bool knows(const std::string& name, std::size_t statement) const;
  /// The innermost function around a statement.
  std::optional<Function> function_around(std::size_t statement) const;

 private:
  void read_python();
  void read_cpp();
  std::string code_of(std::size_t statement) const;
  bool binds(std::size_t statement, const std::string& name) const;
  Function read_function(std::size_t statement) const;

  std::string text_, code_;
  std::vector<Statement> statements_;
};

/// Where `anchor` stands in code, line breaks and spaces between its words aside, within one statement.
struct Match {
  std::size_t begin = 0;
  std::size_t end = 0;
};
std::vector<Match> find_words(const SourceCode& source, const std::string& anchor);

/// The statement most like a piece of code; nullopt where none is like it at all.
std::optional<std::size_t> nearest_statement(const SourceCode& source, const std::string& anchor);

}  // namespace splatboost::patch
