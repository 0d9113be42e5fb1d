// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <string>

#include "projection/tile_lists.h"
#include "splatboost/errors.h"
#include "splatboost/rasterizer.h"

namespace splatboost::test {
namespace {

constexpr std::uint32_t kMaxEntries = 0xffffffffu;

/// Three blocks of Gaussians; the last listing of each ends the block's entries.
TileLists listed_frame(std::uint32_t first, std::uint32_t second, std::uint32_t third) {
  TileLists frame;
  frame.primitives = 2 * kProjectGrain + 5;
  frame.listings.ensure(frame.primitives);
  frame.listings[kProjectGrain - 1] = {first - 1, 1};
  frame.listings[2 * kProjectGrain - 1] = {0, second};
  frame.listings[frame.primitives - 1] = {third, 0};
  return frame;
}

TEST(TileLists, NumberTheSlotsOfThePieces) {
  TileLists frame = listed_frame(7, 11, 3);
  EXPECT_EQ(number_slots(frame), 21u);
  EXPECT_EQ(frame.piece_slot[0], 0u);
  EXPECT_EQ(frame.piece_slot[1], 7u);
  EXPECT_EQ(frame.piece_slot[2], 18u);
  EXPECT_EQ(frame.piece_slot[3], 21u);
}

TEST(TileLists, HoldAsManyEntriesAs32BitsCanNumber) {
  TileLists frame = listed_frame(kMaxEntries / 2, kMaxEntries / 2, 1);
  EXPECT_EQ(number_slots(frame), kMaxEntries);
}

TEST(TileLists, RefuseMoreEntriesThanThat) {
  for (const std::uint32_t third : {2u, kMaxEntries}) {
    TileLists frame = listed_frame(kMaxEntries / 2, kMaxEntries / 2, third);
    try {
      number_slots(frame);
      ADD_FAILURE() << "nothing was thrown";
    } catch (const ArgumentError& error) {
      EXPECT_NE(std::string(error.what()).find("smaller images"), std::string::npos) << error.what();
    }
  }
}

// The lists of more tiles would be shorter than what is written to them.
TEST(TileLists, ImagesOfMoreTilesThanAFloatCountsExactlyAreRefused) {
  Threads threads(1);
  Rasterizer rasterizer(threads);
  const Camera camera{65536 + 1, 65536, 1000, 1000, 0, 0, glm::mat4(1.0f)};
  try {
    rasterizer.forward(camera, Gaussians{}, RasterOptions{}, RasterImages{});
    ADD_FAILURE() << "nothing was thrown";
  } catch (const ArgumentError& error) {
    EXPECT_NE(std::string(error.what()).find("2^24 tiles"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace splatboost::test
