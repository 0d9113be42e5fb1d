// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "splatboost/errors.h"
#include "splatboost/rows.h"

namespace splatboost::test {
namespace {

using Tensor = std::vector<float>;
using Mask = std::vector<std::uint8_t>;
using List = std::vector<std::uint32_t>;

Array<float> on_cpu(Tensor values) {
  static Threads threads{1};
  return {threads, std::move(values)};
}

TEST(Rows, RemoveKeepsTheOthersInOrder) {
  Tensor tensor{0, 1, 10, 11, 20, 21, 30, 31};
  remove_rows(tensor, 2, Mask{1, 0, 0, 200});
  EXPECT_EQ(tensor, (Tensor{10, 11, 20, 21}));
  remove_rows(tensor, 2, Mask{0, 0});
  EXPECT_EQ(tensor, (Tensor{10, 11, 20, 21}));
  remove_rows(tensor, 2, Mask{1, 1});
  EXPECT_TRUE(tensor.empty());
  remove_rows(tensor, 2, Mask{});
  EXPECT_TRUE(tensor.empty());
}

TEST(Rows, WidthsOfOneAndMany) {
  Tensor scalars{1, 2, 3};
  remove_rows(scalars, 1, Mask{0, 1, 0});
  EXPECT_EQ(scalars, (Tensor{1, 3}));
  Tensor wide(45 * 3);
  for (std::size_t k = 0; k < wide.size(); ++k) wide[k] = static_cast<float>(k);
  remove_rows(wide, 45, Mask{1, 0, 1});
  ASSERT_EQ(wide.size(), 45u);
  for (std::size_t k = 0; k < 45; ++k) EXPECT_EQ(wide[k], static_cast<float>(45 + k));
}

TEST(Rows, AppendCopies) {
  Array<float> tensor = on_cpu({0, 1, 10, 11, 20, 21});
  append_rows(tensor, 2, List{2, 0, 2});
  EXPECT_EQ(tensor.to_host(), (Tensor{0, 1, 10, 11, 20, 21, 20, 21, 0, 1, 20, 21}));
  append_rows(tensor, 2, {});
  EXPECT_EQ(tensor.size(), 12u);
  // Many rows: the tensor is reallocated while it is also the source.
  append_rows(tensor, 2, List(10000, 1));
  ASSERT_EQ(tensor.size(), 12u + 20000u);
  EXPECT_EQ(tensor.to_host()[20010], 10);
  EXPECT_EQ(tensor.to_host()[20011], 11);
}

TEST(Rows, AppendRowsOfAnother) {
  Array<float> tensor = on_cpu({1, 2});
  append_rows_of(Tensor{10, 11, 20, 21}, 2, List{1, 1}, tensor);
  EXPECT_EQ(tensor.to_host(), (Tensor{1, 2, 20, 21, 20, 21}));
}

TEST(Rows, AppendZeros) {
  Array<float> tensor = on_cpu({1, 2, 3});
  append_zero_rows(tensor, 3, 2);
  EXPECT_EQ(tensor.to_host(), (Tensor{1, 2, 3, 0, 0, 0, 0, 0, 0}));
  append_zero_rows(tensor, 3, 0);
  EXPECT_EQ(tensor.size(), 9u);
}

TEST(Rows, SelectLeavesTheListInItsOrder) {
  Array<float> tensor = on_cpu({1, 2, 3, 4, 5, 6}), workspace;
  EXPECT_THROW(select_rows(tensor, 2, List{0, 1, 3}, workspace), ArgumentError);
  select_rows(tensor, 2, List{2, 0, 1}, workspace);
  EXPECT_EQ(tensor.to_host(), (Tensor{5, 6, 1, 2, 3, 4}));
  select_rows(tensor, 2, kept_rows(Mask{0, 9, 0}), workspace);
  EXPECT_EQ(tensor.to_host(), (Tensor{5, 6, 3, 4}));
  select_rows(tensor, 2, List{1, 1, 0}, workspace);
  EXPECT_EQ(tensor.to_host(), (Tensor{3, 4, 3, 4, 5, 6}));
}

TEST(Rows, SelectMovesAscendingRowsInPlace) {
  constexpr std::uint32_t kRows = 1000;
  constexpr std::size_t kWidth = 45;
  Tensor values(kRows * kWidth), expected;
  List kept;
  for (std::uint32_t row = 0; row < kRows; ++row) {
    for (std::size_t c = 0; c < kWidth; ++c) values[kWidth * row + c] = static_cast<float>(1000 * c + row);
    if (row % 3 == 1) continue;
    kept.push_back(row);
    expected.insert(expected.end(), &values[kWidth * row], &values[kWidth * row] + kWidth);
  }
  Array<float> tensor = on_cpu(values), workspace;
  const float* const before = tensor.span().data();
  select_rows(tensor, kWidth, kept, workspace);
  EXPECT_EQ(tensor.to_host(), expected);
  EXPECT_EQ(tensor.span().data(), before);
  EXPECT_TRUE(workspace.empty());
  tensor.reserve(values.size());
  EXPECT_EQ(tensor.span().data(), before) << "growth within the memory of removed rows moves nothing";
}

TEST(Rows, Ascend) {
  EXPECT_TRUE(rows_ascend(List{}));
  EXPECT_TRUE(rows_ascend(List{5}));
  EXPECT_TRUE(rows_ascend(List{0, 2, 3}));
  EXPECT_FALSE(rows_ascend(List{0, 2, 2}));
  EXPECT_FALSE(rows_ascend(List{1, 0}));
}

}  // namespace
}  // namespace splatboost::test
