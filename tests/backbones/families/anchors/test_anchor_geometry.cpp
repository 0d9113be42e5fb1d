// SPDX-License-Identifier: Apache-2.0
// Anchors decoded by a view, new cells, and statistics of slots, against direct implementations.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "families/anchors/anchor_cells.h"
#include "families/anchors/anchor_prefilter.h"
#include "families/anchors/slot_statistics.h"
#include "support/tiny_scene.h"

namespace splatboost {
namespace {

TEST(AnchorPrefilter, sees_what_the_rasterizer_would_list_in_the_3_sigma_square) {
  constexpr std::size_t kAnchors = 4000;
  Threads threads(2);
  const RandomStream random(3, 0, RandomPurpose::synth);
  std::vector<float> positions, scales6, scales3, rotations, opacities(kAnchors, 1.0f), colors(3 * kAnchors, 0.5f);
  std::uint64_t next = 0;
  for (std::size_t i = 0; i < kAnchors; ++i) {
    for (int c = 0; c < 3; ++c) positions.push_back(static_cast<float>(3 * random.normal(next++)));
    for (int c = 0; c < 3; ++c) {
      const auto s = static_cast<float>(std::exp(random.normal(next++) - 3));
      scales6.push_back(s);
      scales3.push_back(s);
    }
    scales6.insert(scales6.end(), 3, 1e9f);  // the other three belong to its Gaussians, not to the anchor
    rotations.insert(rotations.end(), {1, 0, 0, 0});
  }
  Gaussians gaussians;
  gaussians.count = kAnchors;
  gaussians.means = positions;
  gaussians.scales = scales3;
  gaussians.rotations = rotations;
  gaussians.opacities = opacities;
  gaussians.colors = colors;
  Rasterizer rasterizer(threads);
  std::size_t seen = 0;
  for (const glm::vec3 eye : {glm::vec3(4, 0.5f, 1), glm::vec3(-1, 2, 0.4f), glm::vec3(0.1f, 0.1f, 0.3f)}) {
    const Camera camera = testing::camera_looking_at_origin(eye, 75, 53);
    std::vector<float> image(3 * 75 * 53);
    RasterImages images;
    images.color = image;
    rasterizer.forward(camera, gaussians, RasterOptions{}, images);
    std::vector<std::uint8_t> mask;
    std::vector<std::uint32_t> visible;
    anchors_in_view(camera, positions, scales6, {}, threads, mask, visible);
    std::size_t differ = 0;
    for (std::size_t i = 0; i < kAnchors; ++i) differ += mask[i] != rasterizer.visible()[i];
    EXPECT_LE(differ, 2u) << "only where rounding decides";
    EXPECT_TRUE(std::is_sorted(visible.begin(), visible.end()));
    seen += visible.size();

    std::vector<std::uint8_t> candidates(kAnchors);
    for (std::size_t i = 0; i < kAnchors; i += 3) candidates[i] = 1;
    std::vector<std::uint32_t> some;
    anchors_in_view(camera, positions, scales6, candidates, threads, mask, some);
    std::erase_if(visible, [](std::uint32_t i) { return i % 3 != 0; });
    EXPECT_EQ(some, visible);
  }
  EXPECT_GT(seen, 500u);
  EXPECT_LT(seen, 3 * kAnchors - 500);
}

TEST(AnchorCells, points_round_to_the_nearest_cell_and_halves_to_even) {
  const CellGrid grid{0.5f, {1, 0, 0}};
  const float point[3] = {1.26f, 0.25f, -0.75f};  // (0.52, 0.5, −1.5) cells from the origin
  EXPECT_EQ(grid.cell_of(point), (Cell{1, 0, -2}));
  EXPECT_EQ(grid.centre_of({1, 0, -2}), (std::array<float, 3>{1.5f, 0, -1}));
  const float far[3] = {1e30f, -1e30f, 0};
  EXPECT_GT(grid.cell_of(far)[0], 9000000000000000000);
  EXPECT_LT(grid.cell_of(far)[1], -9000000000000000000);
  const std::vector<float> on_a_map{5.4e6f, -4.2e6f, 100};  // in metres: over 2³¹ cells of a millimetre
  const std::vector<float> centre = occupied_centres({0.001f, {}}, on_a_map);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(centre[c], on_a_map[c], 1);
  EXPECT_EQ(occupied_centres({1, {}}, std::vector<float>{3.2f, 0, 0, 1.4f, 0, 0, 2.9f, 0.3f, 0}),
            (std::vector<float>{1, 0, 0, 3, 0, 0}));
}

TEST(AnchorCells, new_cells_are_those_that_nothing_is_in) {
  const RandomStream random(1, 0, RandomPurpose::synth);
  std::vector<float> points, held;
  for (std::uint64_t i = 0; i < 900; ++i) points.push_back(static_cast<float>(2 * random.normal(i)));
  for (std::uint64_t i = 0; i < 300; ++i) held.push_back(static_cast<float>(2 * random.normal(5000 + i)));
  const CellGrid grid{0.7f, {}};
  std::map<Cell, std::vector<std::uint32_t>> expected;
  std::set<Cell> taken;
  for (std::size_t i = 0; i < held.size(); i += 3) taken.insert(grid.cell_of(&held[i]));
  for (std::uint32_t i = 0; i < points.size() / 3; ++i) {
    const Cell cell = grid.cell_of(&points[3 * i]);
    if (!taken.contains(cell)) expected[cell].push_back(i);
  }
  const NewCells found = new_cells(grid, points, held);
  ASSERT_EQ(found.cells.size(), expected.size());
  ASSERT_LT(found.cells.size(), 300u);
  std::size_t i = 0;
  for (const auto& [cell, sources] : expected) {
    EXPECT_EQ(found.cells[i], cell);
    EXPECT_EQ(found.sources[i++], sources);
  }
  EXPECT_TRUE(new_cells(grid, {}, held).cells.empty());
}

TEST(SlotStatistics, judges_only_what_was_seen_often_and_restarts_only_that) {
  Threads threads(2);
  SlotStatistics statistics(2, threads);
  statistics.reset(3);  // slots 0 1 | 2 3 | 4 5
  const std::vector<std::uint32_t> anchors{0, 2}, slots{0, 4, 5};
  const std::vector<float> opacities{0.5f, -0.9f, 0.001f, 0.002f};
  const std::vector<std::uint8_t> drawn{1, 1, 0};
  const std::vector<float> gradients{3e-3f, 4e-3f, 0, 1e-3f, 9, 9};
  for (int view = 0; view < 3; ++view) {
    statistics.add_anchors(anchors, opacities);
    statistics.add_gaussians(slots, drawn, gradients, 200, 100);
  }
  std::vector<float> means;
  statistics.mean_gradients(means);
  EXPECT_NEAR(means[0], std::hypot(3e-3f * 100, 4e-3f * 50), 1e-6);
  EXPECT_NEAR(means[4], 0.05, 1e-6);
  EXPECT_EQ(means[1] + means[2] + means[3] + means[5], 0) << "a Gaussian that the view did not draw says nothing";
  using Mask = std::vector<std::uint8_t>;
  Mask mask;
  statistics.slots_seen_over(2.5, mask);
  EXPECT_EQ(mask, (Mask{1, 0, 0, 0, 1, 0}));
  statistics.slots_seen_over(3, mask);
  EXPECT_EQ(mask, (Mask{0, 0, 0, 0, 0, 0})) << "more often than the bar, not as often";
  statistics.faint_anchors(2, 0.005, mask);
  EXPECT_EQ(mask, (Mask{0, 0, 1})) << "anchor 0 is opaque, anchor 1 was never seen";
  statistics.restart_slots(Mask{1, 0, 0, 0, 0, 0});
  statistics.restart_anchors_seen_over(2);
  statistics.slots_seen_over(0, mask);
  EXPECT_EQ(mask, (Mask{0, 0, 0, 0, 1, 0}));
  statistics.faint_anchors(0, 1, mask);
  EXPECT_EQ(mask, (Mask{0, 0, 0}));
  statistics.append(1);
  Array<float> workspace;
  statistics.select(std::vector<std::uint32_t>{1, 2, 3}, workspace);
  EXPECT_EQ(statistics.anchors(), 3u);
  statistics.slots_seen_over(0, mask);
  EXPECT_EQ(mask, (Mask{0, 0, 1, 0, 0, 0})) << "rows follow their anchors";
}

}  // namespace
}  // namespace splatboost
