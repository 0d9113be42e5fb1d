// SPDX-License-Identifier: Apache-2.0
#include "tool/edits/unified_diff.h"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace splatboost::patch {
namespace {

constexpr std::size_t kContext = 3;

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size() - 1) + 1;
    lines.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  return lines;
}

/// A line of the diff: ' ' in both, '-' before only, '+' after only.
struct Row {
  char sign;
  std::string_view line;
};

/// Rows of the diff, by the longest common subsequence of the lines between common prefix and common suffix.
std::vector<Row> rows_of(const std::vector<std::string_view>& a, const std::vector<std::string_view>& b) {
  std::size_t start = 0;
  while (start < a.size() && start < b.size() && a[start] == b[start]) ++start;
  std::size_t end = 0;
  while (end < a.size() - start && end < b.size() - start && a[a.size() - 1 - end] == b[b.size() - 1 - end]) ++end;
  const std::size_t n = a.size() - start - end, m = b.size() - start - end;

  // common[i·(m+1)+j]: length of the longest common subsequence from line i of a and line j of b on
  std::vector<std::uint32_t> common((n + 1) * (m + 1), 0);
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t j = m; j-- > 0;) {
      common[i * (m + 1) + j] = a[start + i] == b[start + j]
                                    ? common[(i + 1) * (m + 1) + j + 1] + 1
                                    : std::max(common[(i + 1) * (m + 1) + j], common[i * (m + 1) + j + 1]);
    }
  }
  std::vector<Row> rows;
  for (std::size_t i = 0; i < start; ++i) rows.push_back({' ', a[i]});
  std::size_t i = 0, j = 0;
  while (i < n || j < m) {
    if (i < n && j < m && a[start + i] == b[start + j]) {
      rows.push_back({' ', a[start + i]});
      ++i, ++j;
    } else if (i < n && (j == m || common[(i + 1) * (m + 1) + j] >= common[i * (m + 1) + j + 1])) {
      rows.push_back({'-', a[start + i++]});
    } else {
      rows.push_back({'+', b[start + j++]});
    }
  }
  for (std::size_t k = a.size() - end; k < a.size(); ++k) rows.push_back({' ', a[k]});
  return rows;
}

std::string range(std::size_t first, std::size_t count) {
  // An empty range gives the line before it.
  const std::string start = std::to_string(count == 0 ? first : first + 1);
  return count == 1 ? start : start + "," + std::to_string(count);
}

}  // namespace

Diff unified_diff(std::string_view before, std::string_view after, const std::string& path) {
  const std::vector<std::string_view> a = lines_of(before), b = lines_of(after);
  const std::vector<Row> rows = rows_of(a, b);
  Diff diff;
  std::size_t line_a = 0, line_b = 0;  // of rows[at]
  for (std::size_t at = 0; at < rows.size();) {
    if (rows[at].sign == ' ') {
      ++at, ++line_a, ++line_b;
      continue;
    }
    // A hunk: from the context before this change to the context after the last change close enough to share it.
    const std::size_t lead = std::min(kContext, at);
    std::size_t last = at;
    for (std::size_t k = at; k < rows.size() && k <= last + 2 * kContext; ++k) {
      if (rows[k].sign != ' ') last = k;
    }
    const std::size_t stop = std::min(rows.size(), last + kContext + 1);
    std::string body;
    std::size_t count_a = 0, count_b = 0;
    for (std::size_t k = at - lead; k < stop; ++k) {
      body += rows[k].sign;
      body += rows[k].line;
      if (rows[k].line.back() != '\n') body += "\n\\ No newline at end of file\n";
      count_a += rows[k].sign != '+';
      count_b += rows[k].sign != '-';
      diff.removed += rows[k].sign == '-';
      diff.added += rows[k].sign == '+';
    }
    diff.text += "@@ -" + range(line_a - lead, count_a) + " +" + range(line_b - lead, count_b) + " @@\n" + body;
    line_a += count_a - lead;
    line_b += count_b - lead;
    at = stop;
  }
  if (!diff.text.empty()) diff.text = "--- a/" + path + "\n+++ b/" + path + "\n" + diff.text;
  return diff;
}

}  // namespace splatboost::patch
