// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "splatboost/errors.h"
#include "splatboost/rows.h"

namespace splatboost::test {
namespace {

using Tensor = std::vector<float>;
using Mask = std::vector<std::uint8_t>;

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
  Tensor tensor{0, 1, 10, 11, 20, 21};
  append_rows(tensor, 2, std::vector<std::uint32_t>{2, 0, 2});
  EXPECT_EQ(tensor, (Tensor{0, 1, 10, 11, 20, 21, 20, 21, 0, 1, 20, 21}));
  append_rows(tensor, 2, {});
  EXPECT_EQ(tensor.size(), 12u);
  // Many rows: the tensor moves in memory while it reads itself.
  std::vector<std::uint32_t> rows(10000, 1);
  append_rows(tensor, 2, rows);
  ASSERT_EQ(tensor.size(), 12u + 20000u);
  EXPECT_EQ(tensor[20010], 10);
  EXPECT_EQ(tensor[20011], 11);
}

TEST(Rows, AppendZeros) {
  Tensor tensor{1, 2, 3};
  append_zero_rows(tensor, 3, 2);
  EXPECT_EQ(tensor, (Tensor{1, 2, 3, 0, 0, 0, 0, 0, 0}));
  append_zero_rows(tensor, 3, 0);
  EXPECT_EQ(tensor.size(), 9u);
}

TEST(Rows, Reorder) {
  std::vector<float> tensor = {1, 2, 3, 4, 5, 6};
  reorder_rows(tensor, 2, std::vector<std::uint32_t>{2, 0, 1});
  EXPECT_EQ(tensor, (std::vector<float>{5, 6, 1, 2, 3, 4}));
  EXPECT_THROW(reorder_rows(tensor, 2, std::vector<std::uint32_t>{0, 1}), ArgumentError);
  EXPECT_THROW(reorder_rows(tensor, 2, std::vector<std::uint32_t>{0, 1, 3}), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test
