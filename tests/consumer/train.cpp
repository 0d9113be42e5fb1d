// SPDX-License-Identifier: Apache-2.0
// A training loop of one's own, accelerated by the adapter of 3DGS: Gaussians of constant colour learn views of other
// Gaussians, from few points. Everything is from the installed core and adapter.
#include <splatboost/activations.h>
#include <splatboost/adam.h>
#include <splatboost/density_statistics.h>
#include <splatboost/hooks.h>
#include <splatboost/photometric.h>
#include <splatboost/random.h>
#include <splatboost/rasterizer.h>
#include <splatboost/rows.h>
#include <vanilla/vanilla_adapter.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <glm/geometric.hpp>
#include <numeric>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

namespace {

using namespace splatboost;

constexpr int kIterations = 1500, kViews = 12, kSize = 48;

/// A parameter group: values of all Gaussians, row-major, with their gradients and the state of Adam.
struct Group {
  std::string_view name;
  std::size_t width;
  float rate;
  std::vector<float> values, gradients, first, second;
  int steps = 0;
  bool pending = false;  ///< has gradients that no step has used

  Group(std::string_view of_name, std::size_t of_width, float of_rate, std::vector<float> from)
      : name(of_name), width(of_width), rate(of_rate), values(std::move(from)) {
    gradients.resize(values.size());
    first.resize(values.size());
    second.resize(values.size());
  }
  void append_copy_of(std::size_t row) {
    for (std::size_t c = 0; c < width; ++c) values.push_back(values[row * width + c]);
    for (auto* of : {&gradients, &first, &second}) of->resize(values.size());  // zeros
  }
  void remove(std::span<const std::uint8_t> removed) {
    for (auto* of : {&values, &gradients, &first, &second}) remove_rows(*of, width, removed);
  }
};

struct View {
  Camera camera;
  std::vector<std::uint8_t> color;  ///< [3,H,W]
  TruthImage truth() const { return {camera.width, camera.height, color, {}}; }
};

/// The backbone. Adapters see it as a RasterizerHook.
class Model final : public RasterizerHook {
 public:
  Model(std::vector<float> means, std::vector<float> colors, float scale, float opacity, Threads& threads)
      : threads_(threads), rasterizer_(threads), photometric_(threads) {
    const std::size_t n = means.size() / 3;
    std::vector<float> rotations(4 * n);
    for (std::size_t i = 0; i < n; ++i) rotations[4 * i] = 1;
    groups_.emplace_back("xyz", 3, 2e-3f, std::move(means));
    groups_.emplace_back("f_dc", 3, 1e-2f, std::move(colors));
    groups_.emplace_back("scaling", 3, 1e-2f, std::vector<float>(3 * n, std::log(scale)));
    groups_.emplace_back("rotation", 4, 2e-3f, std::move(rotations));
    groups_.emplace_back("opacity", 1, 5e-2f, std::vector<float>(n, std::log(opacity / (1 - opacity))));
  }

  // ---- RasterizerHook

  void set_beta(std::optional<float> beta) override {
    options_.box = beta ? BoxPolicy::ellipse : BoxPolicy::square;
    options_.beta = beta.value_or(1.0f);
  }
  std::size_t primitives() const override { return groups_[0].values.size() / 3; }
  std::size_t scorable_views() const override { return views_.size(); }
  ScoredView render_for_score(std::size_t view) override {
    draw(views_[view].camera);
    rasterizer_.settle();  // does nothing on the CPU
    return {image_, views_[view].truth()};
  }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    rasterizer_.count_flagged(flagged, counts);
  }
  void add_weights(std::span<std::int32_t> weights) override { rasterizer_.add_weights(weights); }

  // ---- rendering

  std::span<const float> draw(const Camera& camera) {
    scales_.resize(group(kScaling).values.size());
    opacities_.resize(primitives());
    exponentials(group(kScaling).values, scales_, threads_);
    sigmoids(group(kOpacity).values, opacities_, threads_);
    image_.resize(3 * kSize * kSize);
    RasterImages images;
    images.color = image_;
    rasterizer_.forward(camera, gaussians(), options_, images);
    return image_;
  }

  // ---- training

  /// @return PSNR over all views
  double train(std::vector<View> views, VanillaAdapter& adapter) {
    views_ = std::move(views);
    set_beta(adapter.beta());
    restart_statistics();
    for (int iteration = 1; iteration <= kIterations; ++iteration) {
      const Moment moment{iteration, kIterations};
      learn(views_[static_cast<std::size_t>(iteration) % views_.size()]);
      step(moment, adapter, false);
      // This loop has no rule of its own: the adapter alone decides.
      if (adapter.grows_at(moment, false)) {
        step(moment, adapter, true);
        grow(moment, adapter);
        prune(moment, adapter, PruneRule::growth);
        restart_statistics();
      } else if (adapter.prunes_at(moment, false)) {
        step(moment, adapter, true);
        prune(moment, adapter, PruneRule::late);
        restart_statistics();
      }
    }
    return psnr();
  }

 private:
  enum { kMeans, kColors, kScaling, kRotation, kOpacity };
  Group& group(int number) { return groups_[static_cast<std::size_t>(number)]; }

  Gaussians gaussians() {
    Gaussians g;
    g.count = primitives();
    g.means = group(kMeans).values;
    g.colors = group(kColors).values;
    g.scales = scales_;
    g.rotations = group(kRotation).values;
    g.opacities = opacities_;
    return g;
  }

  /// Adds the gradients of one view, and its statistics.
  void learn(const View& view) {
    draw(view.camera);
    image_gradients_.resize(image_.size());
    photometric_.evaluate(image_, view.truth(), 0.2f, image_gradients_);
    const std::size_t n = primitives();
    screen_.resize(2 * n);
    screen_abs_.resize(2 * n);
    std::vector<float> scale_gradients(3 * n), opacity_gradients(n);
    GaussianGradients g;
    g.mode = GradientMode::accumulate;
    g.means = group(kMeans).gradients;
    g.colors = group(kColors).gradients;
    g.scales = scale_gradients;
    g.rotations = group(kRotation).gradients;
    g.opacities = opacity_gradients;
    g.screen_means = screen_;
    g.screen_means_abs = screen_abs_;
    RasterImageGradients upstream;
    upstream.color = image_gradients_;
    rasterizer_.backward(gaussians(), upstream, g);
    exponential_gradients(scales_, scale_gradients, threads_);
    sigmoid_gradients(opacities_, opacity_gradients, threads_);
    for (std::size_t i = 0; i < 3 * n; ++i) group(kScaling).gradients[i] += scale_gradients[i];
    for (std::size_t i = 0; i < n; ++i) group(kOpacity).gradients[i] += opacity_gradients[i];
    for (Group& of : groups_) of.pending = true;
    add_screen_gradients({rasterizer_.visible(), screen_, screen_abs_, kSize, kSize}, AbsoluteNorm::euclidean, 1,
                         {norms_, norms_abs_, seen_}, threads_);
  }

  /// @param all whether groups step that would wait: before primitives change
  void step(Moment moment, const VanillaAdapter& adapter, bool all) {
    for (Group& g : groups_) {
      if (!g.pending || (!all && !adapter.steps_at(g.name, moment))) continue;
      g.pending = false;
      AdamOptions options;
      options.learning_rate = g.rate * adapter.rate_factor(g.name, moment);
      adam_step(g.values, g.gradients, g.first, g.second, ++g.steps, options, threads_);
    }
  }

  DensityStatistics statistics(Moment moment) {
    const std::size_t n = primitives();
    means_.resize(n);
    means_abs_.resize(n);
    longest_.resize(n);
    scales_.resize(3 * n);
    opacities_.resize(n);
    mean_screen_gradients({norms_, norms_abs_, seen_}, means_, means_abs_, threads_);
    exponentials(group(kScaling).values, scales_, threads_);
    sigmoids(group(kOpacity).values, opacities_, threads_);
    longest_scales(scales_, longest_, threads_);
    DensityStatistics known;
    known.moment = moment;
    known.scene_extent = 4.4f;  // cameras are 4 from their mean
    known.gradients = means_;
    known.gradients_abs = means_abs_;
    known.max_scales = longest_;
    known.opacities = opacities_;
    return known;
  }

  void grow(Moment moment, VanillaAdapter& adapter) {
    const std::size_t n = primitives();
    std::vector<std::uint8_t> clone(n), split(n);
    GrowDecisions decisions{clone, split};
    adapter.grow(statistics(moment), *this, decisions);
    origins_.resize(n);
    std::iota(origins_.begin(), origins_.end(), 0u);
    for (std::size_t i = 0; i < n; ++i) {
      // A clone keeps its original; a split has two smaller children at the ends of the longest axis of its box.
      for (int child = 0; child < (split[i] != 0 ? 2 : clone[i] != 0 ? 1 : 0); ++child) {
        const std::size_t row = primitives();
        for (Group& g : groups_) g.append_copy_of(i);
        origins_.push_back(static_cast<std::uint32_t>(i));
        if (split[i] == 0) continue;
        float* scaling = &group(kScaling).values[3 * row];
        const std::size_t axis = static_cast<std::size_t>(std::max_element(scaling, scaling + 3) - scaling);
        group(kMeans).values[3 * row + axis] += (child == 0 ? 0.5f : -0.5f) * std::exp(scaling[axis]);
        for (std::size_t c = 0; c < 3; ++c) scaling[c] -= std::log(1.6f);
      }
    }
    split.resize(primitives());
    remove(split);
  }

  void prune(Moment moment, VanillaAdapter& adapter, PruneRule rule) {
    restart_statistics();
    const DensityStatistics known = statistics(moment);
    std::vector<std::uint8_t> removed(primitives());
    if (rule == PruneRule::growth) {  // candidates of its own
      for (std::size_t i = 0; i < removed.size(); ++i) removed[i] = known.opacities[i] < 0.005f;
    } else {
      origins_.clear();
    }
    PruneDecisions decisions{removed, rule, origins_};
    adapter.prune(known, *this, decisions);
    remove(removed);
  }

  void remove(std::span<const std::uint8_t> removed) {
    for (Group& g : groups_) g.remove(removed);
    if (origins_.empty()) return;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < removed.size(); ++i) {
      if (removed[i] == 0) origins_[kept++] = origins_[i];
    }
    origins_.resize(kept);
  }

  void restart_statistics() {
    for (auto* of : {&norms_, &norms_abs_, &seen_}) of->assign(primitives(), 0.0f);
  }

  double psnr() {
    double sum = 0;
    for (const View& view : views_) {
      draw(view.camera);
      for (std::size_t p = 0; p < image_.size(); ++p) {
        const double difference = image_[p] - static_cast<float>(view.color[p]) / 255.0f;
        sum += difference * difference;
      }
    }
    return -10 * std::log10(sum / static_cast<double>(views_.size() * image_.size()));
  }

  Threads& threads_;
  Rasterizer rasterizer_;
  Photometric photometric_;
  RasterOptions options_;
  std::vector<Group> groups_;
  std::vector<View> views_;
  std::vector<float> scales_, opacities_, image_, image_gradients_, screen_, screen_abs_;
  std::vector<float> norms_, norms_abs_, seen_, means_, means_abs_, longest_;
  std::vector<std::uint32_t> origins_;  ///< of the last growth
};

/// A camera at `angle` on a ring of radius 4 that looks at the origin.
Camera camera_at(float angle) {
  Camera camera;
  camera.width = camera.height = kSize;
  camera.fx = camera.fy = 1.2f * kSize;
  camera.cx = camera.cy = kSize / 2.0f;
  const glm::vec3 centre(4 * std::cos(angle), 0, 4 * std::sin(angle));
  const glm::vec3 forward = glm::normalize(-centre), down(0, 1, 0), right = glm::cross(down, forward);
  const glm::mat3 world_from_camera(right, down, forward);
  camera.camera_from_world = glm::mat4(glm::transpose(world_from_camera));
  camera.camera_from_world[3] = glm::vec4(glm::transpose(world_from_camera) * -centre, 1);
  return camera;
}

}  // namespace

int main() {
  Threads threads;
  const RandomStream random(1, 0, RandomPurpose::synth);
  std::vector<float> means, colors;
  for (std::uint64_t k = 0; k < 3 * 200; ++k) {
    means.push_back(static_cast<float>(2 * random.uniform(k) - 1));
    colors.push_back(static_cast<float>(random.uniform(1000 + k)));
  }
  std::vector<View> views;
  Model truth(means, colors, 0.12f, 0.9f, threads);
  for (int v = 0; v < kViews; ++v) {
    View view{camera_at(6.2832f * static_cast<float>(v) / kViews), {}};
    for (const float value : truth.draw(view.camera)) {
      view.color.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f))));
    }
    views.push_back(std::move(view));
  }

  constexpr std::size_t kPoints = 40;
  means.resize(3 * kPoints);
  Model model(means, std::vector<float>(3 * kPoints, 0.5f), 0.2f, 0.5f, threads);
  VanillaBoost boost;
  boost.training_views = kViews;
  VanillaAdapter adapter(boost, threads);
  const double psnr = model.train(views, adapter);
  std::printf("%zu points became %zu Gaussians, %.1f dB over the training views\n", kPoints, model.primitives(), psnr);
  return psnr > 25 && model.primitives() > 2 * kPoints ? 0 : 1;
}
