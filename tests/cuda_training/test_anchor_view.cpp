// SPDX-License-Identifier: Apache-2.0
// Decoding the anchors of a view on a GPU, against the CPU: matrix products, Gaussians, gradients of all inputs, the
// volume loss, statistics, levels of detail.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "cuda/cuda_device.h"
#include "families/anchors/anchor_view.h"
#include "families/anchors/slot_statistics.h"
#include "octree_gs/usable_anchors.h"
#include "splatboost/array.h"
#include "support/decoder_models.h"
#include "support/scenes.h"
#include "support/tiny_scene.h"

namespace splatboost::test {
namespace {

using testing::Model;
using testing::Options;

constexpr std::size_t kAnchors = 700;
constexpr float kBefore = 0.5f;  // gradients accumulate on this

/// All outputs of a view by slot, so that both devices can be compared whatever their order and gaps.
using BySlot = std::map<std::uint32_t, std::vector<float>>;

struct Outcome {
  std::size_t rows = 0;
  std::vector<std::uint32_t> anchors;
  BySlot gaussians;
  std::map<std::uint32_t, std::vector<float>> all_opacities;  ///< by anchor
  double volume_loss = 0;
  std::map<std::string, std::vector<float>> gradients;
};

class CudaAnchorView : public OnCuda<::testing::TestWithParam<Options>> {
 protected:
  Outcome outcome(const Model<float>& model, std::span<const std::uint8_t> usable, Device device) {
    const DecoderShape& shape = model.shape;
    const auto there = [&](const std::vector<float>& values) { return Array<float>(device, values); };
    const Array<float> positions = there(model.positions), offsets = there(model.offsets),
                       features = there(model.features), scales = there(model.scales), levels = there(model.levels),
                       opacity = there(model.opacity_net), covariance = there(model.covariance_net),
                       color = there(model.color_net), bank = there(model.bank_net), embedding = there(model.embedding);
    DecoderInputs<float> inputs{positions, offsets, features, scales, {}, opacity, covariance, color, bank, embedding};
    if (shape.level) inputs.levels = levels;
    const Array<std::uint8_t> usable_there(device, std::vector<std::uint8_t>(usable.begin(), usable.end()));

    AnchorView view(shape, device);
    const Camera camera = testing::camera_looking_at_origin({0.4f, -0.6f, 1.2f}, 64, 48);
    Outcome found;
    // Two calls: the second must not depend on the first.
    view.decode(testing::camera_looking_at_origin({-3, 0, 1}, 64, 48), inputs, {}, false);
    const ViewGaussians& g = view.decode(camera, inputs, usable_there, false);
    const std::vector<std::uint32_t> slots = copy_to_host(g.slots, device);
    const std::vector<float> means = copy_to_host(g.means, device), sizes = copy_to_host(g.scales, device),
                             turns = copy_to_host(g.rotations, device), colors = copy_to_host(g.colors, device),
                             opacities = copy_to_host(g.opacities, device), all = copy_to_host(g.all_opacities, device);
    found.anchors = copy_to_host(g.anchors, device);
    found.rows = found.anchors.size();
    for (std::size_t v = 0; v < found.anchors.size(); ++v) {
      if (found.anchors[v] == kNothing) continue;
      found.all_opacities[found.anchors[v]] = {&all[shape.offsets * v], &all[shape.offsets * (v + 1)]};
    }
    std::erase(found.anchors, kNothing);

    // Gradients depend on the slot, so that both devices are given the same.
    std::vector<float> by_means(3 * g.count), by_scales(3 * g.count), by_turns(4 * g.count), by_colors(3 * g.count),
        by_opacities(g.count);
    for (std::size_t i = 0; i < g.count; ++i) {
      if (slots[i] == kNothing) {
        EXPECT_LT(opacities[i], 0.0f) << "not drawn";
        continue;
      }
      std::vector<float>& row = found.gaussians[slots[i]];
      row.insert(row.end(), &means[3 * i], &means[3 * i] + 3);
      row.insert(row.end(), &sizes[3 * i], &sizes[3 * i] + 3);
      row.insert(row.end(), &turns[4 * i], &turns[4 * i] + 4);
      row.insert(row.end(), &colors[3 * i], &colors[3 * i] + 3);
      row.push_back(opacities[i]);
      const std::vector<float> given = numbers(14, -1, 1, 100 + slots[i]);
      std::copy_n(&given[0], 3, &by_means[3 * i]);
      std::copy_n(&given[3], 3, &by_scales[3 * i]);
      std::copy_n(&given[6], 4, &by_turns[4 * i]);
      std::copy_n(&given[10], 3, &by_colors[3 * i]);
      by_opacities[i] = given[13];
    }
    Array<float> scale_gradients = there(by_scales);
    found.volume_loss = view.add_volume_loss(0.01, scale_gradients, false);

    std::map<std::string, Array<float>> gradients;
    const auto gradient = [&](const char* name, const std::vector<float>& of) {
      return gradients.emplace(name, there(std::vector<float>(of.size(), kBefore))).first->second.span();
    };
    const Array<float> given_means = there(by_means), given_turns = there(by_turns),
                       given_opacities = there(by_opacities), given_colors = there(by_colors);
    view.backward(inputs, {given_means, scale_gradients, given_turns, given_opacities, given_colors},
                  {gradient("offsets", model.offsets), gradient("features", model.features),
                   gradient("log_scales", model.scales), gradient("opacity_net", model.opacity_net),
                   gradient("covariance_net", model.covariance_net), gradient("color_net", model.color_net),
                   gradient("bank_net", model.bank_net), gradient("embedding", model.embedding)});
    for (const auto& [name, values] : gradients) found.gradients[name] = values.to_host();
    return found;
  }

  Threads threads_{1};
};

void expect_near(const std::vector<float>& found, const std::vector<float>& expected, const std::string& what) {
  ASSERT_EQ(found.size(), expected.size()) << what;
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(found[i], expected[i], 2e-5 * (1 + std::abs(expected[i]))) << what << " " << i;
  }
}

TEST_P(CudaAnchorView, IsThatOfTheCpu) {
  Model<float> model(GetParam().shape, kAnchors);
  for (float& value : model.positions) value *= 3;  // all around the camera, so that some are behind it
  std::vector<std::uint8_t> usable(kAnchors, 1);
  for (std::size_t i = 0; i < kAnchors; i += 7) usable[i] = 0;
  const Outcome expected = outcome(model, usable, threads_), found = outcome(model, usable, stream());
  ASSERT_GT(expected.anchors.size(), 4u);
  ASSERT_LT(expected.anchors.size(), kAnchors - 6) << "some anchors shall be out of view";
  ASSERT_LT(expected.gaussians.size(), expected.anchors.size() * GetParam().shape.offsets) << "some not drawn";
  EXPECT_EQ(found.anchors, expected.anchors);
  EXPECT_LT(found.rows, kAnchors);
  ASSERT_EQ(found.gaussians.size(), expected.gaussians.size());
  for (const auto& [slot, row] : expected.gaussians) {
    ASSERT_TRUE(found.gaussians.contains(slot));
    expect_near(found.gaussians.at(slot), row, "slot " + std::to_string(slot));
  }
  for (const auto& [anchor, row] : expected.all_opacities) {
    expect_near(found.all_opacities.at(anchor), row, "opacities of anchor " + std::to_string(anchor));
  }
  EXPECT_GT(expected.volume_loss, 0);
  EXPECT_NEAR(found.volume_loss, expected.volume_loss, 1e-5 * expected.volume_loss);
  for (const auto& [name, values] : expected.gradients) {
    expect_near(found.gradients.at(name), values, name);
    if (!values.empty()) {
      EXPECT_TRUE(std::ranges::any_of(values, [](float v) { return v != kBefore; })) << name;
    }
  }
}

TEST_P(CudaAnchorView, OfNoAnchorInViewHasNoGaussians) {
  const Model<float> model(GetParam().shape, kAnchors);
  const std::vector<std::uint8_t> none(kAnchors, 0);
  const Outcome found = outcome(model, none, stream());
  EXPECT_TRUE(found.anchors.empty());
  EXPECT_TRUE(found.gaussians.empty());
  EXPECT_EQ(found.volume_loss, 0);
  for (const auto& [name, values] : found.gradients) {
    EXPECT_TRUE(std::ranges::all_of(values, [](float v) { return v == kBefore; })) << name;
  }
}

INSTANTIATE_TEST_SUITE_P(Shapes, CudaAnchorView, ::testing::ValuesIn(testing::all_options()),
                         [](const auto& options) { return options.param.name; });

using CudaAnchors = OnCuda<>;

TEST_F(CudaAnchors, RowsFollowTheViews) {
  constexpr std::size_t kMany = 3000;
  Model<float> model(testing::all_options().front().shape, kMany);
  for (float& value : model.positions) value *= 3;  // most are behind the camera or outside of the image
  const auto there = [&](const std::vector<float>& values) { return Array<float>(stream(), values); };
  const Array<float> positions = there(model.positions), offsets = there(model.offsets),
                     features = there(model.features), scales = there(model.scales), levels = there(model.levels),
                     opacity = there(model.opacity_net), covariance = there(model.covariance_net),
                     color = there(model.color_net), bank = there(model.bank_net), embedding = there(model.embedding);
  const DecoderInputs<float> inputs{positions, offsets,    features, scales, {},
                                    opacity,   covariance, color,    bank,   embedding};
  AnchorView view(model.shape, stream());
  /// Anchors in view, and the number of rows allocated for them.
  const auto listed = [&](const Camera& camera, bool ahead) {
    const ViewGaussians& g = view.decode(camera, inputs, {}, ahead);
    EXPECT_EQ(g.count, g.anchors.size() * model.shape.offsets);
    std::vector<std::uint32_t> anchors = copy_to_host(g.anchors, stream());  // waits: the number has arrived
    const std::size_t rows = anchors.size();
    std::erase(anchors, kNothing);
    return std::pair(anchors, rows);
  };
  const Camera few = testing::camera_looking_at_origin({0.1f, -0.2f, 0.3f}, 64, 48),
               many = testing::camera_looking_at_origin({0, 0, -20}, 64, 48);
  const std::vector<std::uint32_t> in_few = listed(few, false).first, in_many = listed(many, false).first;
  ASSERT_LT(in_few.size(), kMany / 4);
  ASSERT_GT(in_many.size(), kMany / 2);

  view.forget_views();
  int with_all = 0;
  while (listed(few, true).second == kMany && with_all < 100) ++with_all;
  EXPECT_NEAR(with_all, 64, 1);  // the number of a view may arrive before the next one's rows are allocated
  const auto [anchors, rows] = listed(few, true);
  EXPECT_EQ(anchors, in_few);
  EXPECT_LT(rows, kMany / 2);
  // A view with more anchors than rows drops the last of them, unless their number arrives at once. The number is known
  // before the next view.
  const auto [cut, room] = listed(many, true);
  EXPECT_TRUE(room == rows || cut == in_many);
  EXPECT_EQ(
      cut, std::vector(in_many.begin(), in_many.begin() + static_cast<std::ptrdiff_t>(std::min(room, in_many.size()))));
  EXPECT_EQ(listed(many, true).first, in_many);
  view.forget_views();
  EXPECT_EQ(listed(few, true).second, kMany);
  // A call that waits gets all anchors, whatever the views before.
  view.forget_views();
  const auto [exactly, enough] = listed(few, false);
  EXPECT_EQ(exactly, in_few);
  EXPECT_LT(enough, kMany / 2);
  EXPECT_EQ(listed(many, false).first, in_many);
}

TEST_F(CudaAnchors, StatisticsAreThoseOfTheCpu) {
  constexpr std::uint32_t kSlots = 3, kCount = 50;
  Threads threads(1);
  const auto statistics_of = [&](Device device) {
    SlotStatistics statistics(kSlots, device);
    statistics.reset(kCount);
    for (std::uint64_t view = 0; view < 3; ++view) {
      std::vector<std::uint32_t> anchors, slots;
      std::vector<std::uint8_t> drawn;
      for (std::uint32_t a = static_cast<std::uint32_t>(view); a < kCount; a += 2) {
        anchors.push_back(a);
        for (std::uint32_t j = 0; j < kSlots; ++j) {
          if ((a + j) % 3 == 0) continue;
          slots.push_back(kSlots * a + j);
          drawn.push_back(a % 5 != 0);
        }
      }
      std::vector<float> opacities = numbers(kSlots * anchors.size(), -1, 1, view);
      std::vector<float> gradients = numbers(2 * slots.size(), -1, 1, 10 + view);
      if (device.is_cuda()) {  // padding, as a view on a GPU has it
        anchors.push_back(kNothing);
        opacities.insert(opacities.end(), kSlots, 1e9f);
        slots.push_back(kNothing);
        drawn.push_back(1);
        gradients.insert(gradients.end(), 2, 1e9f);
      }
      const Array<std::uint32_t> anchors_there(device, anchors), slots_there(device, slots);
      const Array<std::uint8_t> drawn_there(device, drawn);
      const Array<float> opacities_there(device, opacities), gradients_there(device, gradients);
      statistics.add_anchors(anchors_there, opacities_there);
      statistics.add_gaussians(slots_there, drawn_there, gradients_there, 30, 20);
    }
    std::vector<std::uint8_t> judged, faint;
    statistics.slots_seen_over(1, judged);
    statistics.faint_anchors(1, 0.6, faint);
    statistics.restart_slots(judged);
    statistics.restart_anchors_seen_over(1);
    statistics.reserve(kCount + 2);
    statistics.append(2);
    std::vector<std::uint32_t> kept;
    for (std::uint32_t i = 3; i < kCount + 2; i += 2) kept.push_back(i);
    Array<float> workspace(device);
    statistics.select(Array<std::uint32_t>(device, kept), workspace);
    EXPECT_EQ(statistics.anchors(), kept.size());
    std::vector<float> means;
    statistics.mean_gradients(means);
    std::vector<std::uint8_t> seen;
    statistics.slots_seen_over(0, seen);
    return std::tuple(judged, faint, means, seen);
  };
  const auto expected = statistics_of(threads), found = statistics_of(stream());
  EXPECT_EQ(std::get<0>(found), std::get<0>(expected));
  EXPECT_EQ(std::get<1>(found), std::get<1>(expected));
  expect_near(std::get<2>(found), std::get<2>(expected), "mean gradients");
  EXPECT_EQ(std::get<3>(found), std::get<3>(expected));
  EXPECT_TRUE(std::ranges::any_of(std::get<1>(expected), [](std::uint8_t f) { return f != 0; }));
}

TEST_F(CudaAnchors, CountsGoToTheirSlots) {
  const Array<std::uint32_t> slots(stream(), {4, kNothing, 0, 2});
  const Array<std::int32_t> view_counts(stream(), {5, 9, 0, 7});
  Array<std::int32_t> counts(stream(), {1, 1, 1, 1, 1});
  add_slot_counts(slots, view_counts, counts, stream());
  EXPECT_EQ(counts.to_host(), (std::vector<std::int32_t>{1, 1, 8, 1, 6}));
}

TEST_F(CudaAnchors, ViewsUseTheSameLevels) {
  constexpr std::size_t kCount = 300;
  Threads threads(1);
  const std::vector<float> positions = numbers(3 * kCount, -3, 3, 1), extra = numbers(kCount, 0, 1, 2);
  std::vector<float> levels;
  for (std::size_t i = 0; i < kCount; ++i) levels.push_back(static_cast<float>(i % 4));
  for (const LevelRounding rounding : {LevelRounding::round, LevelRounding::floor, LevelRounding::ceil}) {
    const LevelsInUse rule{{0.2f, -0.1f, 0.4f}, 6, 2, rounding, 3, {0.4f, 0.2f, 0.1f, 0.05f}};
    const auto usable_on = [&](Device device) {
      const Array<float> at(device, positions), level(device, levels), more(device, extra);
      Array<std::uint8_t> usable(device);
      usable.ensure(kCount);
      usable_anchors(rule, at, level, more, usable, device);
      return usable.to_host();
    };
    const std::vector<std::uint8_t> expected = usable_on(threads);
    EXPECT_EQ(usable_on(stream()), expected);
    EXPECT_TRUE(std::ranges::any_of(expected, [](std::uint8_t u) { return u == 0; }));
    EXPECT_TRUE(std::ranges::any_of(expected, [](std::uint8_t u) { return u != 0; }));
  }
}

}  // namespace
}  // namespace splatboost::test
