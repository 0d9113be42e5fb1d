// SPDX-License-Identifier: Apache-2.0
// Views rendered without colour: everything else is as with it.
#include <gtest/gtest.h>

#include <algorithm>
#include <ostream>
#include <vector>

#include "splatboost/rasterizer.h"
#include "support/scenes.h"
#include "support/tested_rasterizer.h"

namespace splatboost::test {
namespace {

struct WithoutColorCase {
  int features;
  bool inverse_depth;
  bool colors;  ///< of the Gaussians, instead of spherical harmonics
};

void PrintTo(const WithoutColorCase& c, std::ostream* to) {
  *to << c.features << (c.colors ? " features, colors" : " features, harmonics") << (c.inverse_depth ? ", depth" : "");
}

class WithoutColor : public ::testing::TestWithParam<WithoutColorCase> {
 protected:
  WithoutColor() {
    SceneSpec spec;
    spec.count = 150;
    spec.features = GetParam().features;
    spec.colors = GetParam().colors;
    scene = random_scene(camera, spec, 23);
    options.background = {0.3f, 0.5f, 0.7f};
  }

  RasterImages wanted(ImageData& images, bool color) const {
    RasterImages view = images.view();
    if (!color) view.color = {};
    if (!GetParam().inverse_depth) view.inverse_depth = {};
    return view;
  }

  Camera camera = oblique_camera(70, 45);
  SceneData scene;
  RasterOptions options;
  Threads threads{2};
  Rasterizer with{threads}, without{threads};
};

TEST_P(WithoutColor, ImagesAndGradientsAreTheSame) {
  ImageData drawn(camera, scene.features_per_gaussian), bare(camera, scene.features_per_gaussian);
  with.forward(camera, scene.view(), options, wanted(drawn, true));
  without.forward(camera, scene.view(), options, wanted(bare, false));
  EXPECT_EQ(bare.alpha, drawn.alpha);
  EXPECT_EQ(bare.features, drawn.features);
  if (GetParam().inverse_depth) {
    EXPECT_EQ(bare.inverse_depth, drawn.inverse_depth);
  }
  EXPECT_TRUE(std::ranges::equal(without.visible(), with.visible()));
  EXPECT_TRUE(std::ranges::equal(without.screen_radii(), with.screen_radii()));

  const ImageGradientData driving(camera, scene.features_per_gaussian, 31, {});
  RasterImageGradients upstream = driving.view();
  upstream.color = {};
  if (!GetParam().inverse_depth) upstream.inverse_depth = {};
  GradientData of_drawn(scene), of_bare(scene);
  with.backward(scene.view(), upstream, of_drawn.view());
  without.backward(scene.view(), upstream, of_bare.view());
  for (std::size_t k = 0; k < of_bare.all().size(); ++k) expect_same_gradients(*of_bare.all()[k], *of_drawn.all()[k]);
  for (const std::vector<float>& rows : {of_bare.sh_dc, of_bare.sh_rest, of_bare.colors}) {
    EXPECT_EQ(rows, std::vector<float>(rows.size(), 0.0f));
  }
}

TEST_P(WithoutColor, AccumulationLeavesTheGradientsOfColoursAlone) {
  ImageData bare(camera, scene.features_per_gaussian);
  without.forward(camera, scene.view(), options, wanted(bare, false));
  const ImageGradientData driving(camera, scene.features_per_gaussian, 31, {});
  RasterImageGradients upstream = driving.view();
  upstream.color = {};
  if (!GetParam().inverse_depth) upstream.inverse_depth = {};
  GradientData gradients(scene, 2.0f);
  without.backward(scene.view(), upstream, gradients.view(GradientMode::accumulate));
  for (const std::vector<float>& rows : {gradients.sh_dc, gradients.sh_rest, gradients.colors}) {
    EXPECT_EQ(rows, std::vector<float>(rows.size(), 2.0f));
  }
  EXPECT_NE(gradients.means, std::vector<float>(gradients.means.size(), 2.0f));
}

TEST_P(WithoutColor, NoImageAtAllIsEnoughForCounts) {
  ImageData drawn(camera, scene.features_per_gaussian);
  with.forward(camera, scene.view(), options, drawn.view());
  without.forward(camera, scene.view(), options, {});
  const std::vector<std::uint8_t> flagged(70 * 45, 1);
  const auto counts = [&](Rasterizer& rasterizer) {
    std::vector<std::int32_t> sums(scene.count, 0);
    rasterizer.count_flagged(flagged, sums);
    rasterizer.count_observed(0.5f, sums);
    rasterizer.add_weights(sums);
    return sums;
  };
  EXPECT_EQ(counts(without), counts(with));
  // Without any image there is no gradient.
  GradientData gradients(scene);
  without.backward(scene.view(), {}, gradients.view());
  EXPECT_EQ(gradients.means, std::vector<float>(gradients.means.size(), 0.0f));
  EXPECT_EQ(gradients.screen_means_abs, std::vector<float>(gradients.screen_means_abs.size(), 0.0f));
}

INSTANTIATE_TEST_SUITE_P(Channels, WithoutColor,
                         ::testing::Values(WithoutColorCase{0, false, false}, WithoutColorCase{0, true, true},
                                           WithoutColorCase{2, true, false}, WithoutColorCase{4, false, false},
                                           WithoutColorCase{4, false, true}, WithoutColorCase{8, true, false}));

}  // namespace
}  // namespace splatboost::test
