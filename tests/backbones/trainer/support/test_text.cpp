// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/text.h"

#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <vector>

namespace splatboost::test {
namespace {

TEST(Text, KnowsUtf8) {
  for (const char* good : {"", "plain", "Grüße", "\u20ac", "\U0001f600", "\xf4\x8f\xbf\xbf", "\xed\x9f\xbf"}) {
    EXPECT_TRUE(is_utf8(good)) << good;
  }
  for (const char* bad : {"\xe9", "caf\xe9.jpg", "\xc3", "\xc0\xaf", "\xe0\x80\xaf", "\xf0\x80\x80\xaf", "\xed\xa0\x80",
                          "\xf4\x90\x80\x80", "\xff", "\x80", "\xe2\x82", "\xe2\x82 "}) {
    EXPECT_FALSE(is_utf8(bad)) << printable(bad);
  }
}

TEST(Text, ShowsWhatNoTerminalShould) {
  EXPECT_EQ(printable("Grüße \u20ac"), "Grüße \u20ac");
  EXPECT_EQ(printable("caf\xe9.jpg"), "caf\\xe9.jpg");
  EXPECT_EQ(printable(std::string("a\0\x1b[2J\n\x7f", 8)), "a\\x00\\x1b[2J\\x0a\\x7f");
  EXPECT_EQ(printable("\xc2\x80 \xc2\x9b\xc2\xa0"), "\\xc2\\x80 \\xc2\\x9b\xc2\xa0");
  EXPECT_EQ(printable("\xe2\x82"), "\\xe2\\x82");
  EXPECT_TRUE(is_utf8(printable("\xff\xfe\xe2\x82\xc3\xa4")));
}

TEST(Text, QuotesWordsForAShell) {
  EXPECT_EQ(shell_word("out/fox_1-2.json"), "out/fox_1-2.json");
  EXPECT_EQ(shell_word("my photos"), "'my photos'");
  EXPECT_EQ(shell_word("it's $HOME"), "'it'\\''s $HOME'");
  EXPECT_EQ(shell_word(""), "''");
}

TEST(Text, OrdersNumbersByTheirValue) {
  std::vector<std::string> ordered;
  std::istringstream words(
      "0 00 01.png 1.png 2.png 10.png a a/b2 a/b10 cam1/9.jpg cam2/1.jpg cam10 f1a2 f01a03 f1b "
      "f18446744073709551615 f18446744073709551616 f\xc3");
  for (std::string word; words >> word;) ordered.push_back(word);
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    for (std::size_t j = 0; j < ordered.size(); ++j) {
      EXPECT_EQ(in_number_order(ordered[i], ordered[j]), i < j) << ordered[i] << " " << ordered[j];
    }
  }
}

}  // namespace
}  // namespace splatboost::test
