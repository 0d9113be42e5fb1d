// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/json_values.h"

#include <gtest/gtest.h>

#include <string>

#include "support/temporary_folder.h"

namespace splatboost::test {
namespace {

TEST(ParseJson, TakesCommentsAndNamesTheMistake) {
  EXPECT_EQ(parse_json("{\"a\": 1 // one\n}", "x")["a"], 1);
  expect_contains(input_error_of([] { parse_json("{\"a\": 1,\n oops}", "x.json"); }), "x.json: not JSON: ");
  expect_contains(input_error_of([] { parse_json("", "x.json"); }), "x.json: not JSON: ");
}

TEST(ParseJson, RefusesNumbersThatNoDoubleHolds) {
  const std::string message = input_error_of([] { parse_json("{\"a\": 1e400}", "x.json"); });
  expect_contains(message, "x.json: a number is out of range");
  expect_contains(message, "1e400");
  EXPECT_EQ(message.find("json.exception"), std::string::npos) << message;
}

TEST(ParseJson, RefusesWhatIsNestedTooDeep) {
  const auto nested = [](std::size_t levels) {
    std::string text;
    for (std::size_t i = 0; i < levels; ++i) text += "{\"a\":";
    return text + "1" + std::string(levels, '}');
  };
  EXPECT_TRUE(parse_json(nested(60), "x").is_object());
  expect_contains(input_error_of([&] { parse_json(nested(1'000'000), "x.json"); }), "x.json: is nested deeper than");
  expect_contains(input_error_of([] { parse_json(std::string(1'000'000, '['), "x.json"); }), "nested deeper");
}

TEST(ParseJson, RefusesAKeyThatOccursTwiceInAnObject) {
  const auto refused = [](const std::string& text) { return input_error_of([&] { parse_json(text, "x.json"); }); };
  EXPECT_EQ(refused(R"({"a": 1, "b": 2, "a": 1})"), "x.json: the key 'a' occurs twice");
  EXPECT_EQ(refused(R"({"a": {"b": {}, "c": [{"d": 1}, {"e": 1, "e": null}]}})"), "x.json: the key 'e' occurs twice");
  EXPECT_EQ(refused(R"({"a": {"b": {}}, "c": 1, "a": {}})"), "x.json: the key 'a' occurs twice");
  EXPECT_TRUE(parse_json(R"({"a": {"a": [{"a": 1}, {"a": 2}]}, "b": {"a": {}}})", "x").is_object());
}

TEST(ReadValue, RefusesNumbersThatNoFloatHolds) {
  float value = 1;
  expect_contains(input_error_of([&] { read_value(nlohmann::json(1e300), "rate", value); }),
                  "rate must be a number in");
  EXPECT_EQ(value, 1);
  read_value(nlohmann::json(-2.5), "rate", value);
  EXPECT_EQ(value, -2.5f);
}

}  // namespace
}  // namespace splatboost::test
