// SPDX-License-Identifier: Apache-2.0
/// @file The structure of a source file, as far as edits and checks of a host need it: statements in Python, C++ and
/// CMake; also functions, calls and names in Python. Nothing is run; invalid code gives some result, never an error.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace splatboost::patch {

enum class Language {
  python,
  cpp,   ///< C++ and CUDA
  other  ///< comments, brackets and strings as in Python, such as CMake
};

/// The language of a file, by its extension.
Language language_of(const std::string& file);

/// A statement: one line, or several joined by brackets, backslashes or a string over several lines. In C++ lines are
/// joined up to one that ends in a semicolon, brace or colon: the head of a function is one statement, and its body
/// consists of further ones.
struct Statement {
  std::size_t begin = 0;  ///< of its first line
  std::size_t end = 0;    ///< past its last character, before the line end
  int line = 1;           ///< number of its first line
  int indent = 0;         ///< number of leading spaces and tabs; meaningless if `empty`
  bool empty = true;      ///< only white space and comments
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
  std::vector<std::string> positional;  ///< text of each argument
  std::vector<std::string> keywords;    ///< names
  bool unpacked = false;                ///< has *… or **…
  int results = 0;                      ///< number of names the results are assigned to; 0: not assigned directly
  std::size_t statement = 0;
};

class SourceCode {
 public:
  explicit SourceCode(std::string text, Language language = Language::python);

  const std::string& text() const { return text_; }
  const std::vector<Statement>& statements() const { return statements_; }
  /// Index of the statement that contains an offset into the text.
  std::size_t statement_at(std::size_t place) const;
  /// A statement on one line, without comments and repeated spaces, truncated for messages.
  std::string show(std::size_t statement) const;
  /// The text with comments and the insides of strings blanked out.
  const std::string& code() const { return code_; }
  /// The text with only comments blanked out.
  const std::string& without_comments() const { return without_comments_; }

  // The following are for Python only.
  std::vector<Function> functions(const std::string& name) const;
  /// Calls of `name` or `a.name`, as it is written.
  std::vector<Call> calls(const std::string& name) const;

  /// Names that the statements read but do not set themselves.
  std::vector<std::string> names_used(std::size_t first_statement, std::size_t last_statement) const;
  /// Whether a name may be defined at a statement: in an enclosing function, above it, or, if the statement is in a
  /// function, anywhere at module level.
  bool knows(const std::string& name, std::size_t statement) const;
  /// The innermost function that encloses a statement.
  std::optional<Function> function_around(std::size_t statement) const;

 private:
  void read_python();
  void read_cpp();
  std::string code_of(std::size_t statement) const;
  bool binds(std::size_t statement, const std::string& name) const;
  Function read_function(std::size_t statement) const;

  std::string text_, code_, without_comments_;
  std::vector<Statement> statements_;
};

/// An occurrence of an anchor within one statement, regardless of line breaks, spaces and comments between its words.
struct Match {
  std::size_t begin = 0;
  std::size_t end = 0;
};
std::vector<Match> find_words(const SourceCode& source, const std::string& anchor);

/// Whether each name in a piece of code also occurs in a text, in comments and strings too.
bool has_names_of(const std::string& text, const std::string& code);

/// How often a text has the names in a piece of code, in total, in comments and strings too.
int count_names_of(const std::string& text, const std::string& code);

/// The statement most similar to a piece of code; nullopt if none is similar enough.
std::optional<std::size_t> nearest_statement(const SourceCode& source, const std::string& anchor);

}  // namespace splatboost::patch
