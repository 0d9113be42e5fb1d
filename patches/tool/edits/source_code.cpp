// SPDX-License-Identifier: Apache-2.0
#include "tool/edits/source_code.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

namespace splatboost::patch {
namespace {

constexpr std::size_t kShown = 100;  // bytes of a statement shown in a message
constexpr double kMinLikeness = 0.3;

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f'; }
bool is_word(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || (c & 0x80) != 0;
}
bool opens(char c) { return c == '(' || c == '[' || c == '{'; }
bool closes(char c) { return c == ')' || c == ']' || c == '}'; }

struct Token {
  std::string_view text;
  std::size_t at = 0;
  bool word() const { return is_word(text.front()); }
  bool name() const { return word() && (text.front() < '0' || text.front() > '9'); }
};

/// Splits code into words and single other characters; skips white space and backslashes.
std::vector<Token> tokens_of(std::string_view code) {
  std::vector<Token> tokens;
  for (std::size_t at = 0; at < code.size();) {
    if (is_space(code[at]) || code[at] == '\\') {
      ++at;
      continue;
    }
    std::size_t end = at + 1;
    if (is_word(code[at])) {
      while (end < code.size() && is_word(code[end])) ++end;
    }
    tokens.push_back({code.substr(at, end - at), at});
    at = end;
  }
  return tokens;
}

const std::set<std::string, std::less<>>& keywords() {
  static const std::set<std::string, std::less<>> words{
      "False", "None",     "True",  "and",    "as",   "assert", "async",  "await",    "break",
      "class", "continue", "def",   "del",    "elif", "else",   "except", "finally",  "for",
      "from",  "global",   "if",    "import", "in",   "is",     "lambda", "nonlocal", "not",
      "or",    "pass",     "raise", "return", "try",  "while",  "with",   "yield"};
  return words;
}

const std::set<std::string, std::less<>>& builtins() {
  static const std::set<std::string, std::less<>> words{
      "abs",   "all",        "any",   "bool",     "dict",  "enumerate", "float",    "getattr", "hasattr",
      "int",   "isinstance", "len",   "list",     "map",   "max",       "min",      "next",    "object",
      "print", "range",      "repr",  "reversed", "round", "self",      "set",      "setattr", "sorted",
      "str",   "sum",        "super", "tuple",    "type",  "zip",       "__name__", "__file__"};
  return words;
}

/// Splits `code` at commas outside brackets and outside the parameter lists of lambdas.
std::vector<std::string_view> split(std::string_view code) {
  std::vector<std::string_view> pieces;
  int depth = 0;
  std::size_t begin = 0;
  bool lambda = false;
  for (std::size_t at = 0; at <= code.size(); ++at) {
    if (at == code.size() || (code[at] == ',' && depth == 0 && !lambda)) {
      pieces.push_back(code.substr(begin, at - begin));
      begin = at + 1;
    } else if (opens(code[at])) {
      ++depth;
    } else if (closes(code[at])) {
      --depth;
    } else if (depth == 0 && code.substr(at, 6) == "lambda" && (at == 0 || !is_word(code[at - 1]))) {
      lambda = true;  // commas also separate its parameters
    } else if (depth == 0 && code[at] == ':') {
      lambda = false;
    }
  }
  std::erase_if(pieces, [](std::string_view piece) { return std::all_of(piece.begin(), piece.end(), is_space); });
  return pieces;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
  return text;
}

/// Offset of the bracket that closes the one at `open`; code.size() if there is none.
std::size_t closing(std::string_view code, std::size_t open) {
  int depth = 0;
  for (std::size_t at = open; at < code.size(); ++at) {
    if (opens(code[at])) ++depth;
    if (closes(code[at]) && --depth == 0) return at;
  }
  return code.size();
}

/// Offset of the first plain assignment '=' outside brackets, from `from` on; npos if there is none.
std::size_t assignment(std::string_view code, std::size_t from = 0) {
  int depth = 0;
  for (std::size_t at = from; at < code.size(); ++at) {
    if (opens(code[at])) ++depth;
    if (closes(code[at])) --depth;
    if (depth != 0 || code[at] != '=') continue;
    if (at + 1 < code.size() && code[at + 1] == '=') {
      ++at;
      continue;
    }
    if (at > 0 && std::string_view("=!<>+-*/%&|^@:").find(code[at - 1]) != std::string_view::npos) continue;
    return at;
  }
  return std::string_view::npos;
}

/// Adds the names that an assignment to the target `code` sets.
void targets(std::string_view code, std::set<std::string, std::less<>>& names) {
  const std::vector<Token> tokens = tokens_of(code);
  int depth = 0;
  for (std::size_t i = 0; i < tokens.size(); ++i) {
    const bool attribute = i > 0 && tokens[i - 1].text == ".";
    const bool part =
        i + 1 < tokens.size() && (tokens[i + 1].text == "." || tokens[i + 1].text == "[" || tokens[i + 1].text == "(");
    if (tokens[i].text == "[" && i > 0 && (tokens[i - 1].word() || closes(tokens[i - 1].text.front()))) ++depth;
    if (tokens[i].text == "]" && depth > 0) --depth;
    if (depth == 0 && tokens[i].text == ":") return;  // an annotation
    if (depth == 0 && tokens[i].name() && !attribute && !part) names.insert(std::string(tokens[i].text));
  }
}

/// Names that a statement sets.
std::set<std::string, std::less<>> bound_names(std::string_view code) {
  std::set<std::string, std::less<>> names;
  const std::vector<Token> tokens = tokens_of(code);
  if (tokens.empty()) return names;
  const std::size_t first = tokens.front().text == "async" && tokens.size() > 1 ? 1 : 0;
  const std::string_view word = tokens[first].text;
  if (word == "def" || word == "class") {
    if (tokens.size() > first + 1) names.insert(std::string(tokens[first + 1].text));
    return names;
  }
  if (word == "import" || word == "from") {
    std::size_t begin = tokens[first].at + tokens[first].text.size();
    if (word == "from") {
      const auto listing =
          std::find_if(tokens.begin(), tokens.end(), [](const Token& one) { return one.text == "import"; });
      if (listing == tokens.end()) return names;
      begin = listing->at + listing->text.size();
    }
    std::string_view list = trimmed(code.substr(begin));
    if (!list.empty() && list.front() == '(') list = list.substr(1, closing(list, 0) - 1);
    for (const std::string_view item : split(list)) {  // a, a.b, a.b as c, *
      const std::vector<Token> words = tokens_of(item);
      if (words.empty()) continue;
      const bool renamed = words.size() > 2 && words[words.size() - 2].text == "as";
      names.insert(std::string(renamed ? words.back().text : words.front().text));
    }
    return names;
  }
  // for … in, with … as, except … as, :=
  for (std::size_t i = 0; i < tokens.size(); ++i) {
    if (tokens[i].text == "as" && i + 1 < tokens.size()) names.insert(std::string(tokens[i + 1].text));
    if (tokens[i].text == ":" && i > 0 && i + 1 < tokens.size() && tokens[i + 1].text == "=" && tokens[i - 1].name()) {
      names.insert(std::string(tokens[i - 1].text));
    }
    if (tokens[i].text != "for") continue;
    const std::size_t begin = tokens[i].at + tokens[i].text.size();
    for (std::size_t j = i + 1; j < tokens.size(); ++j) {
      if (tokens[j].text != "in") continue;
      targets(code.substr(begin, tokens[j].at - begin), names);
      break;
    }
  }
  std::size_t begin = 0;
  for (std::size_t at = assignment(code); at != std::string_view::npos; at = assignment(code, begin)) {
    targets(code.substr(begin, at - begin), names);
    begin = at + 1;
  }
  return names;
}

}  // namespace

Language language_of(const std::string& file) {
  static const std::set<std::string, std::less<>> endings{".c", ".cc", ".cpp", ".cu", ".cuh", ".cxx", ".h", ".hpp"};
  const std::size_t dot = file.rfind('.');
  const std::string ending = dot == std::string::npos ? "" : file.substr(dot);
  if (ending == ".py") return Language::python;
  return endings.contains(ending) ? Language::cpp : Language::other;
}

SourceCode::SourceCode(std::string text, Language language)
    : text_(std::move(text)), code_(text_), without_comments_(text_) {
  language == Language::cpp ? read_cpp() : read_python();
}

void SourceCode::read_cpp() {
  const std::size_t size = text_.size();
  std::set<std::size_t> within;  // offsets of line ends inside comments and strings
  const auto blank = [&](std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < to && i < size; ++i) {
      if (code_[i] == '\n') {
        within.insert(i);
      } else if (code_[i] != '\r') {
        code_[i] = ' ';
      }
    }
  };
  const auto blank_comment = [&](std::size_t from, std::size_t to) {
    blank(from, to);
    without_comments_.replace(from, to - from, code_, from, to - from);
  };
  for (std::size_t at = 0; at < size;) {
    const char c = text_[at];
    if (text_.compare(at, 2, "//") == 0) {
      const std::size_t end = std::min(text_.find('\n', at), size);
      blank_comment(at, end);
      at = end;
    } else if (text_.compare(at, 2, "/*") == 0) {
      const std::size_t close = text_.find("*/", at + 2);
      const std::size_t end = close == std::string::npos ? size : close + 2;
      blank_comment(at, end);
      at = end;
    } else if (c == '"' && at > 0 && text_[at - 1] == 'R') {
      const std::size_t open = std::min(text_.find('(', at), size);
      const std::string mark = ")" + text_.substr(at + 1, open - at - 1) + "\"";
      const std::size_t end = std::min(text_.find(mark, open), size);
      blank(at + 1, end);
      at = std::min(end + mark.size(), size);
    } else if (c == '"' || (c == '\'' && (at == 0 || !is_word(text_[at - 1])))) {  // not the separator of 1'000
      std::size_t end = at + 1;
      while (end < size && text_[end] != c && text_[end] != '\n') end += text_[end] == '\\' ? 2 : 1;
      end = std::min(end, size);
      blank(at + 1, end);
      at = std::min(end + 1, size);
    } else {
      ++at;
    }
  }
  Statement now;
  int depth = 0;    // nesting of ( and [
  char last = ' ';  // last character of its code
  std::size_t begin = 0;
  for (int line = 1; begin < size || statements_.empty(); ++line) {
    const std::size_t end = std::min(code_.find('\n', begin), size);
    const std::string_view code = trimmed(std::string_view(code_).substr(begin, end - begin));
    for (const char c : code) {
      depth += c == '(' || c == '[';
      depth -= c == ')' || c == ']';
    }
    depth = std::max(depth, 0);
    if (now.empty) {
      now.begin = begin;
      now.line = line;
      now.indent = static_cast<int>(std::min(text_.find_first_not_of(" \t", begin), end) - begin);
      now.empty = code.empty();
    }
    const std::size_t first = text_.find_first_not_of(" \t", now.begin);
    const bool directive = first < size && text_[first] == '#';
    if (!code.empty()) last = code.back();
    const bool ends =
        !within.contains(end) &&
        (directive ? last != '\\' : depth == 0 && (last == ';' || last == '{' || last == '}' || last == ':'));
    if (now.empty || ends || end == size) {
      now.end = end > begin && text_[end - 1] == '\r' ? end - 1 : end;
      statements_.push_back(now);
      now = {};
      last = ' ';
    }
    begin = end + 1;
  }
}

void SourceCode::read_python() {
  // Finds the statements and blanks comments and strings in one pass.
  Statement now;
  int depth = 0, line = 1;
  bool at_indent = true;
  const auto blank = [&](std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < to && i < code_.size(); ++i) {
      if (code_[i] != '\n' && code_[i] != '\r') code_[i] = ' ';
    }
  };
  const std::size_t size = text_.size();
  std::size_t at = 0;
  const auto finish = [&](std::size_t end) {
    now.end = end > now.begin && text_[end - 1] == '\r' ? end - 1 : end;
    statements_.push_back(now);
  };
  while (at < size) {
    const char c = text_[at];
    if (c == '\n') {
      const bool goes_on =
          depth > 0 || (at > 0 && code_[at - 1] == '\\') || (at > 1 && code_[at - 1] == '\r' && code_[at - 2] == '\\');
      ++line;
      ++at;
      if (goes_on) continue;
      finish(at - 1);
      now = {};
      now.begin = at;
      now.line = line;
      at_indent = true;
      continue;
    }
    if (c == '#') {
      const std::size_t end = std::min(text_.find('\n', at), size);
      blank(at, end);
      without_comments_.replace(at, end - at, code_, at, end - at);
      at = end;
      continue;
    }
    if (at_indent && (c == ' ' || c == '\t')) {
      ++now.indent;
      ++at;
      continue;
    }
    if (!is_space(c)) {
      at_indent = false;
      now.empty = false;
    }
    if (c == '"' || c == '\'') {
      const bool triple = text_.compare(at, 3, std::string(3, c)) == 0;
      const std::size_t mark = triple ? 3 : 1;
      std::size_t end = at + mark;
      while (end < size) {
        if (text_[end] == '\\') {
          end += 2;
        } else if (triple ? text_.compare(end, 3, std::string(3, c)) == 0 : text_[end] == c) {
          break;
        } else if (!triple && text_[end] == '\n') {
          break;
        } else {
          ++end;
        }
      }
      end = std::min(end, size);
      blank(at + mark, end);
      line += static_cast<int>(std::count(text_.begin() + static_cast<std::ptrdiff_t>(at),
                                          text_.begin() + static_cast<std::ptrdiff_t>(end), '\n'));
      at = end < size && text_[end] == c ? std::min(end + mark, size) : end;
      continue;
    }
    if (opens(c)) ++depth;
    if (closes(c)) depth = std::max(0, depth - 1);
    ++at;
  }
  if (now.begin < size || statements_.empty()) finish(size);
}

std::size_t SourceCode::statement_at(std::size_t place) const {
  const auto above = std::upper_bound(statements_.begin(), statements_.end(), place,
                                      [](std::size_t at, const Statement& one) { return at < one.begin; });
  return static_cast<std::size_t>(above - statements_.begin()) - 1;
}

std::string SourceCode::code_of(std::size_t statement) const {
  const Statement& one = statements_[statement];
  return code_.substr(one.begin, one.end - one.begin);
}

std::string SourceCode::show(std::size_t statement) const {
  const Statement& one = statements_[statement];
  std::string shown;
  for (std::size_t at = one.begin; at < one.end; ++at) {
    const bool comment = (text_[at] == '#' || text_.compare(at, 2, "//") == 0) && code_[at] == ' ' && !one.empty;
    if (comment) {
      at = std::min(text_.find('\n', at), one.end);
      if (at >= one.end) break;
    }
    const bool space = is_space(text_[at]) || static_cast<unsigned char>(text_[at]) < 0x20;
    if (!space) {
      shown += text_[at];
    } else if (!shown.empty() && shown.back() != ' ' && !opens(shown.back())) {
      shown += ' ';
    }
  }
  while (!shown.empty() && shown.back() == ' ') shown.pop_back();
  if (shown.size() > kShown) {
    std::size_t end = kShown;
    while (end > 0 && (shown[end] & 0xC0) == 0x80) --end;  // do not split a UTF-8 character
    shown = shown.substr(0, end) + "…";
  }
  return shown;
}

Function SourceCode::read_function(std::size_t statement) const {
  Function function;
  function.statement = statement;
  const std::string code = code_of(statement);
  const std::size_t open = code.find('(');
  const std::vector<Token> tokens = tokens_of(code);
  for (std::size_t i = 0; i + 1 < tokens.size(); ++i) {
    if (tokens[i].text == "def") {
      function.name = tokens[i + 1].text;
      break;
    }
  }
  if (open != std::string::npos) {
    const std::size_t close = closing(code, open);
    for (const std::string_view piece : split(std::string_view(code).substr(open + 1, close - open - 1))) {
      Parameter parameter;
      std::string_view text = trimmed(piece);
      while (!text.empty() && text.front() == '*') {
        parameter.star = true;
        text.remove_prefix(1);
      }
      if (text == "/") continue;
      const std::vector<Token> words = tokens_of(text);
      if (!words.empty()) parameter.name = words.front().text;
      parameter.optional = assignment(text) != std::string_view::npos;
      function.parameters.push_back(parameter);
    }
  }
  function.last = statement;
  for (std::size_t i = statement + 1; i < statements_.size(); ++i) {
    if (statements_[i].empty) continue;
    if (statements_[i].indent <= statements_[statement].indent) break;
    function.last = i;
  }
  return function;
}

std::vector<Function> SourceCode::functions(const std::string& name) const {
  std::vector<Function> found;
  for (std::size_t i = 0; i < statements_.size(); ++i) {
    const std::string code = code_of(i);
    const std::vector<Token> tokens = tokens_of(code);
    const std::size_t first = !tokens.empty() && tokens.front().text == "async" ? 1 : 0;
    if (tokens.size() > first + 1 && tokens[first].text == "def" && tokens[first + 1].text == name) {
      found.push_back(read_function(i));
    }
  }
  return found;
}

std::vector<Call> SourceCode::calls(const std::string& name) const {
  std::vector<Call> found;
  for (std::size_t i = 0; i < statements_.size(); ++i) {
    const std::string code = code_of(i);
    for (std::size_t at = code.find(name); at != std::string::npos; at = code.find(name, at + 1)) {
      if (at > 0 && (is_word(code[at - 1]) || code[at - 1] == '.')) continue;
      std::size_t open = at + name.size();
      while (open < code.size() && (code[open] == ' ' || code[open] == '\t')) ++open;
      if (open >= code.size() || code[open] != '(') continue;
      const std::string_view before = trimmed(std::string_view(code).substr(0, at));
      if (before == "def" || before == "class" || before == "async def") continue;
      Call call;
      call.statement = i;
      const std::size_t close = closing(code, open);
      for (const std::string_view piece : split(std::string_view(code).substr(open + 1, close - open - 1))) {
        const std::string_view text = trimmed(piece);
        const std::size_t equals = assignment(text);
        if (text.front() == '*') {
          call.unpacked = true;
        } else if (equals != std::string_view::npos && text.substr(0, 6) != "lambda") {
          call.keywords.emplace_back(trimmed(text.substr(0, equals)));
        } else {
          call.positional.emplace_back(text);
        }
      }
      // Count the results only if the statement is names, '=', the call, and nothing else.
      const bool ends = close >= code.size() || trimmed(std::string_view(code).substr(close + 1)).empty();
      if (ends && !before.empty() && before.back() == '=' && assignment(before) == before.size() - 1) {
        std::string_view names = trimmed(before.substr(0, before.size() - 1));
        if (!names.empty() && names.front() == '(' && closing(names, 0) == names.size() - 1) {
          names = names.substr(1, names.size() - 2);
        }
        call.results = static_cast<int>(split(names).size());
      }
      found.push_back(std::move(call));
    }
  }
  return found;
}

std::vector<std::string> SourceCode::names_used(std::size_t first_statement, std::size_t last_statement) const {
  std::vector<std::string> used;
  std::set<std::string, std::less<>> set;
  for (std::size_t i = first_statement; i <= last_statement && i < statements_.size(); ++i) {
    const std::string code = code_of(i);
    const std::vector<Token> tokens = tokens_of(code);
    if (tokens.empty() || tokens.front().text == "import" || tokens.front().text == "from") {
      set.merge(bound_names(code));
      continue;
    }
    std::set<std::string, std::less<>> own = bound_names(code);
    for (std::size_t j = 0; j < tokens.size(); ++j) {  // parameters of lambdas
      if (tokens[j].text != "lambda") continue;
      for (std::size_t k = j + 1; k < tokens.size() && tokens[k].text != ":"; ++k)
        own.insert(std::string(tokens[k].text));
    }
    int depth = 0;
    for (std::size_t j = 0; j < tokens.size(); ++j) {
      const Token& token = tokens[j];
      if (opens(token.text.front())) ++depth;
      if (closes(token.text.front())) --depth;
      if (!token.name() || keywords().contains(token.text) || (j > 0 && tokens[j - 1].text == ".")) continue;
      const bool string_prefix =
          code.size() > token.at + token.text.size() &&
          (code[token.at + token.text.size()] == '"' || code[token.at + token.text.size()] == '\'');
      const bool keyword = depth > 0 && j + 1 < tokens.size() && tokens[j + 1].text == "=" &&
                           !(j + 2 < tokens.size() && tokens[j + 2].text == "=");
      const bool written = own.contains(token.text) && !set.contains(token.text);
      const std::string name(token.text);
      if (string_prefix || keyword || written || set.contains(name)) continue;
      if (std::find(used.begin(), used.end(), name) == used.end()) used.push_back(name);
    }
    set.merge(own);
  }
  return used;
}

bool SourceCode::binds(std::size_t statement, const std::string& name) const {
  const std::set<std::string, std::less<>> names = bound_names(code_of(statement));
  return names.contains(name) || names.contains("*");
}

std::optional<Function> SourceCode::function_around(std::size_t statement) const {
  int indent = statements_[statement].indent;
  for (std::size_t i = statement; i-- > 0;) {
    if (statements_[i].empty || statements_[i].indent >= indent) continue;
    indent = statements_[i].indent;
    const std::string code = code_of(i);
    const std::vector<Token> tokens = tokens_of(code);
    if (!tokens.empty() && (tokens.front().text == "def" || tokens.front().text == "async")) return read_function(i);
  }
  return std::nullopt;
}

bool SourceCode::knows(const std::string& name, std::size_t statement) const {
  if (builtins().contains(name)) return true;
  // In the enclosing functions: a parameter, or set above the statement.
  std::size_t inner = statement;
  while (const std::optional<Function> function = function_around(inner)) {
    for (const Parameter& parameter : function->parameters) {
      if (parameter.name == name) return true;
    }
    for (std::size_t i = function->statement + 1; i < statement; ++i) {
      if (!statements_[i].empty && binds(i, name)) return true;
    }
    inner = function->statement;
  }
  // At module level, including its if and try blocks. Code in a function runs later, so the name may be set below it.
  const bool in_function = inner != statement;
  for (std::size_t i = 0; i < (in_function ? statements_.size() : statement); ++i) {
    if (statements_[i].empty || !binds(i, name)) continue;
    if (statements_[i].indent == 0 || !function_around(i)) return true;
  }
  return false;
}

std::vector<Match> find_words(const SourceCode& source, const std::string& anchor) {
  const std::string& text = source.text();
  const bool own_comment = anchor.find('#') != std::string::npos || anchor.find("//") != std::string::npos ||
                           anchor.find("/*") != std::string::npos;
  const std::string& plain = own_comment ? text : source.without_comments();
  std::vector<Match> matches;
  if (anchor.empty()) return matches;
  for (std::size_t begin = text.find(anchor.front()); begin != std::string::npos;
       begin = text.find(anchor.front(), begin + 1)) {
    std::size_t at = begin, i = 0;
    bool same = true;
    while (i < anchor.size() && same) {
      if (at < text.size() && text[at] == anchor[i] && !is_space(anchor[i])) {
        ++at;
        ++i;
        continue;
      }
      // Space is required between two words and optional elsewhere.
      const std::size_t old_at = at, old_i = i;
      while (i < anchor.size() && is_space(anchor[i])) ++i;
      while (at < text.size() && (is_space(plain[at]) || text[at] == '\\')) ++at;
      same = (at != old_at || i != old_i) && at < text.size() && i < anchor.size() && text[at] == anchor[i];
      const bool between_words = at > 0 && i > 0 && is_word(anchor[i]) && old_i > 0 && is_word(anchor[old_i - 1]);
      if (same && between_words) same = at != old_at && i != old_i;
    }
    if (!same || i < anchor.size()) continue;
    const bool part_of_word = begin > 0 && is_word(text[begin - 1]) && is_word(anchor.front());
    if (part_of_word || source.statement_at(begin) != source.statement_at(at - 1)) continue;
    matches.push_back({begin, at});
  }
  return matches;
}

bool has_names_of(const std::string& text, const std::string& code) {
  std::set<std::string_view> known;
  for (const Token& token : tokens_of(text)) known.insert(token.text);
  const std::vector<Token> sought = tokens_of(code);
  return std::all_of(sought.begin(), sought.end(),
                     [&](const Token& token) { return !token.name() || known.contains(token.text); });
}

int count_names_of(const std::string& text, const std::string& code) {
  std::set<std::string_view> names;
  for (const Token& token : tokens_of(code)) {
    if (token.name()) names.insert(token.text);
  }
  const std::vector<Token> tokens = tokens_of(text);
  return static_cast<int>(
      std::count_if(tokens.begin(), tokens.end(), [&](const Token& token) { return names.contains(token.text); }));
}

std::optional<std::size_t> nearest_statement(const SourceCode& source, const std::string& anchor) {
  const auto words_of = [](std::string_view code) {
    std::map<std::string, int> words;
    for (const Token& token : tokens_of(code)) {
      if (!token.name()) continue;
      // Compare the parts of names, so that grow_and_prune is similar to densify_and_prune.
      for (std::size_t begin = 0; begin <= token.text.size();) {
        const std::size_t end = std::min(token.text.find('_', begin), token.text.size());
        if (end > begin) ++words[std::string(token.text.substr(begin, end - begin))];
        begin = end + 1;
      }
    }
    return words;
  };
  const std::map<std::string, int> wanted = words_of(anchor);
  std::optional<std::size_t> nearest;
  double best = kMinLikeness;
  const std::string& text = source.text();
  for (std::size_t i = 0; i < source.statements().size(); ++i) {
    const Statement& one = source.statements()[i];
    const std::map<std::string, int> words = words_of(std::string_view(text).substr(one.begin, one.end - one.begin));
    int common = 0, all = 0, sought = 0;
    for (const auto& [word, count] : words) all += count;
    for (const auto& [word, count] : wanted) {
      sought += count;
      const auto same = words.find(word);
      if (same != words.end()) common += std::min(count, same->second);
    }
    if (sought == 0 || all == 0) continue;
    // Fraction of the wanted words that the statement has; among equals the shortest statement wins.
    const double likeness = static_cast<double>(common) / sought - 0.001 * std::min(all, 200);
    if (likeness > best) {
      best = likeness;
      nearest = i;
    }
  }
  return nearest;
}

}  // namespace splatboost::patch
