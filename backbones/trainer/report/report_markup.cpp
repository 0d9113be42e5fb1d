// SPDX-License-Identifier: Apache-2.0
#include "trainer/report/report_markup.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace splatboost::report {

std::string escape(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        // Control characters are not allowed in XML and invisible in HTML.
        if (static_cast<unsigned char>(c) >= 0x20 || c == '\n' || c == '\t') out += c;
    }
  }
  return out;
}

std::string number(double value, int digits) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char kAlphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < count ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= count ? kAlphabet[group >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

std::string human_date(std::string date) {
  if (date.size() != 20 || date[10] != 'T' || date[19] != 'Z') return date;
  date[10] = ' ';
  return date.substr(0, 19) + " UTC";
}

std::string color_of(std::size_t run, std::size_t runs) {
  static const std::array<std::string, 5> kColors = {"#6f7a8b", "#1668dc", "#c2570c", "#0f8a6d", "#8b45c4"};
  return runs == 1 ? kColors[1] : kColors[run % kColors.size()];
}

std::string legend(const std::vector<ReportRun>& runs) {
  if (runs.size() < 2) return "";
  std::string out = "<p class=\"legend\">";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    out += "<span><i style=\"background:" + color_of(i, runs.size()) + "\"></i>" + escape(runs[i].label) + "</span>";
  }
  return out + "</p>\n";
}

std::vector<std::size_t> spread(std::size_t count, std::size_t limit) {
  std::vector<std::size_t> out;
  if (count <= limit) {
    for (std::size_t i = 0; i < count; ++i) out.push_back(i);
  } else if (limit == 1) {
    out.push_back(0);
  } else {
    for (std::size_t i = 0; i < limit; ++i) out.push_back(i * (count - 1) / (limit - 1));
  }
  return out;
}

}  // namespace splatboost::report
