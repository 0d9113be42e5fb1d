// SPDX-License-Identifier: Apache-2.0
/// @file Requirements on every backbone that trains on a GPU: short runs agree with the CPU's, a steady loop without
/// waits, checkpoints and models across devices, growth with too little memory.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <functional>
#include <initializer_list>
#include <memory>
#include <ostream>
#include <string>
#include <type_traits>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/errors.h"
#include "support/backbone_checks.h"
#include "support/tiny_scene.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/dataset/smaller_view.h"
#include "trainer/dataset/splat_ply.h"

#ifdef SPLATBOOST_CUDA_ON_CPU
#include "cuda_on_cpu.h"
#endif

namespace splatboost::test {

/// Observations of a run. On a GPU the loss returned by a step is that of an earlier one, so runs are compared by an
/// image after each step.
struct Trace {
  std::vector<double> errors;  ///< mean absolute error of a test view
  std::vector<std::size_t> primitives;
};

/// @param coarse number of first iterations that train on views of half the size
inline Trace run_of(Backbone& backbone, const Scene& scene, int first, int last, int coarse = 0) {
  Trace trace;
  for (int i = first; i <= last; ++i) {
    const std::vector<View>& views = i <= coarse ? scene.train_halves : scene.train;
    EXPECT_TRUE(std::isfinite(backbone.train_step(i, views[static_cast<std::size_t>(i) % views.size()])));
    const View& shown = scene.test.front();
    const std::vector<float> picture = testing::picture(backbone, shown);
    double sum = 0;
    for (std::size_t p = 0; p < picture.size(); ++p) sum += std::abs(picture[p] - shown.color[p] / 255.0f);
    trace.errors.push_back(sum / static_cast<double>(picture.size()));
    trace.primitives.push_back(backbone.primitives());
  }
  return trace;
}

/// Runs diverge by rounding alone after their first growth: nearby Gaussians may change places in memory, and with them
/// the random numbers of later splits. @param alike number of first iterations that must agree closely
inline void expect_same_run(const Trace& found, const Trace& expected, std::size_t alike) {
  ASSERT_EQ(found.errors.size(), expected.errors.size());
  for (std::size_t i = 0; i < expected.errors.size(); ++i) {
    const double loose = i < alike ? 0.001 : 0.15;
    EXPECT_NEAR(found.errors[i], expected.errors[i], loose * expected.errors[i]) << "iteration " << i + 1;
    const auto primitives = static_cast<double>(expected.primitives[i]);
    EXPECT_NEAR(static_cast<double>(found.primitives[i]), primitives, loose * primitives) << "iteration " << i + 1;
  }
}

/// For the steady loop: never grows, but gathers all statistics.
class NeverGrows : public DensityHook {
  bool needs_absolute_gradients() const override { return true; }
  bool grows_at(Moment, bool) const override { return false; }
  void grow(const DensityStatistics&, RasterizerHook&, GrowDecisions&) override {}
  void prune(const DensityStatistics&, RasterizerHook&, PruneDecisions&) override {}
};

/// A backbone, and its accelerating adapter.
struct Method {
  std::string name;
  std::function<std::unique_ptr<Backbone>(const BackboneContext&)> make;
  /// Installs an adapter. @return the adapter, which must outlive the run
  std::function<std::shared_ptr<void>(Backbone&, Device)> accelerate;
  friend std::ostream& operator<<(std::ostream& out, const Method& method) { return out << method.name; }
};

/// Installs adapters of this type.
template <class Adapter, class Boost>
std::function<std::shared_ptr<void>(Backbone&, Device)> accelerated_by(const Boost& boost) {
  return [boost](Backbone& backbone, Device device) {
    const auto adapter = std::make_shared<Adapter>(boost, device);
    backbone.rasterizer_hook().set_beta(adapter->beta());
    if constexpr (std::is_base_of_v<OptimizerHook, Adapter>) {
      backbone.set_hooks(adapter.get(), adapter.get());
    } else {
      backbone.set_hooks(adapter.get(), nullptr);
    }
    return adapter;
  };
}

class TrainingOnCuda : public OnCuda<::testing::TestWithParam<Method>> {
 protected:
  /// @param iterations number of iterations of a whole run
  explicit TrainingOnCuda(int iterations) : iterations_(iterations) {}

  std::unique_ptr<Backbone> make(Device device) {
    BackboneContext context{scene_, threads_, 3, iterations_, most_primitives_};
    context.device = device;
    return GetParam().make(context);
  }
  Trace run(Backbone& backbone, int first, int last) { return run_of(backbone, scene_, first, last); }
  /// A whole run, accelerated or as published.
  Trace whole_run(Device device, bool boosted) {
    const std::unique_ptr<Backbone> backbone = make(device);
    const std::shared_ptr<void> adapter = boosted ? GetParam().accelerate(*backbone, device) : nullptr;
    return run(*backbone, 1, iterations_);
  }

  /// @param last an iteration before the first growth, so that the runs do not diverge
  void expect_coarse_start_of_the_cpu(int last) {
    for (const View& view : scene_.train) scene_.train_halves.push_back(smaller_view(view, 2));
    const std::unique_ptr<Backbone> there = make(stream()), here = make(threads_), whole = make(threads_);
    const Trace found = run_of(*there, scene_, 1, last, last / 2);
    const Trace expected = run_of(*here, scene_, 1, last, last / 2);
    expect_same_run(found, expected, static_cast<std::size_t>(last));
    EXPECT_NE(run_of(*whole, scene_, 1, last).errors, expected.errors);
  }

  /// Checks iterations 11 to `last`, after a warm-up.
  void expect_no_wait_between_growths(int last) {
    NeverGrows hook;
    const std::unique_ptr<Backbone> backbone = make(stream());
    backbone->set_hooks(&hook, nullptr);
    testing::train(*backbone, scene_, 1, 10);
    backbone->wait();  // all counts have arrived on the host
    testing::train(*backbone, scene_, 8, 10);
    const CudaActivity before = stream().activity();
    testing::train(*backbone, scene_, 11, last);
    EXPECT_EQ(stream().activity().allocations, before.allocations);
    EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
    backbone->wait();
    for (const char* stage : {"render", "loss", "render_backward", "statistics", "optimizer"}) {
      ASSERT_TRUE(backbone->stages().seconds().contains(stage)) << stage;
      EXPECT_GT(backbone->stages().seconds().find(stage)->second, 0) << stage;
    }
  }

  /// @param alike number of iterations without growth after the interruption
  void expect_resume_on_either_device(int cut, int last, std::size_t alike) {
    const TemporaryFolder folder;
    const std::unique_ptr<Backbone> first = make(stream());
    run(*first, 1, cut);
    testing::save_state(*first, folder / "checkpoint");
    const Trace expected = run(*first, cut + 1, last);
    for (const Device device : {Device(stream()), Device(threads_)}) {
      const std::unique_ptr<Backbone> second = make(device);
      testing::load_state(*second, folder / "checkpoint");
      expect_same_run(run(*second, cut + 1, last), expected, device.is_cuda() ? expected.errors.size() : alike);
    }
  }

  void expect_models_and_pictures_of_the_cpu(int iterations) {
    const TemporaryFolder folder;
    const std::unique_ptr<Backbone> trained = make(stream());
    run(*trained, 1, iterations);
    trained->finish();
    trained->export_model(folder.path());
    const std::unique_ptr<Backbone> there = make(stream()), here = make(threads_);
    there->import_model(folder.path());
    here->import_model(folder.path());
    EXPECT_EQ(testing::model_bytes(*there), testing::model_bytes(*here));
    for (const View& view : scene_.test) {
      const std::vector<float> found = testing::picture(*there, view), expected = testing::picture(*here, view);
      // Rounding may decide a (pixel, splat) pair at the threshold of 1/255 differently.
      std::size_t apart = 0;
      for (std::size_t p = 0; p < found.size(); ++p) {
        ASSERT_NEAR(found[p], expected[p], 1.0 / 255);
        apart += std::abs(found[p] - expected[p]) > 1e-5f ? 1 : 0;
      }
      EXPECT_LE(apart, 3u) << "the channels of one pixel";
    }
  }

  /// A run that ends with averages, saved and resumed between the first and the last of them, is that of the CPU.
  void expect_averages_of_the_cpu(int iterations) {
    NeverGrows still;
    testing::AveragesFrom averages(iterations - 2);
    const TemporaryFolder folder;
    std::vector<float> last, found[2];
    for (const bool on_gpu : {false, true}) {
      const auto made = [&] {
        std::unique_ptr<Backbone> backbone = make(on_gpu ? Device(stream()) : Device(threads_));
        backbone->set_hooks(&still, &averages);
        return backbone;
      };
      const std::unique_ptr<Backbone> first = made(), second = made();
      testing::train(*first, scene_, 1, iterations - 1);
      testing::save_state(*first, folder / "checkpoint");
      testing::load_state(*second, folder / "checkpoint");
      testing::train(*second, scene_, iterations, iterations);
      last = testing::picture(*second, scene_.test.front());
      second->finish();
      found[on_gpu ? 1 : 0] = testing::picture(*second, scene_.test.front());
    }
    EXPECT_NE(found[1], last);
    for (std::size_t p = 0; p < last.size(); ++p) ASSERT_NEAR(found[1][p], found[0][p], 1.0 / 255) << p;
  }

#ifdef SPLATBOOST_CUDA_ON_CPU
  /// A run goes on without averages if there is no memory for them.
  void expect_no_averages_without_memory(int iterations) {
    NeverGrows still;
    testing::AveragesFrom averages(iterations - 2);
    const std::unique_ptr<Backbone> backbone = make(stream());
    backbone->set_hooks(&still, &averages);
    testing::train(*backbone, scene_, 1, iterations - 3);
    cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + 64);
    testing::train(*backbone, scene_, iterations - 2, iterations);
    const std::vector<float> last = testing::picture(*backbone, scene_.test.front());
    backbone->finish();
    EXPECT_EQ(testing::picture(*backbone, scene_.test.front()), last);
    cuda_on_cpu::set_device_memory(kPlenty);
  }

  static constexpr std::size_t kPlenty = std::size_t{4} << 30;

  /// @param growth the first iteration that grows @param budgets free bytes at that iteration
  void expect_whole_model_without_memory(int growth, std::initializer_list<unsigned> budgets) {
    int failed = 0;
    for (const std::size_t more : budgets) {
      const std::unique_ptr<Backbone> backbone = make(stream());
      run(*backbone, 1, growth - 1);
      cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + more);
      try {
        run(*backbone, growth, growth);
      } catch (const DeviceMemoryError&) {
        ++failed;
      }
      const TemporaryFolder folder;
      backbone->export_model(folder.path());
      EXPECT_EQ(read_float_ply(folder / "point_cloud.ply", {"x"}).rows(), backbone->primitives());
      cuda_on_cpu::set_device_memory(kPlenty);
      EXPECT_TRUE(std::isfinite(run(*backbone, growth + 1, growth + 2).errors.back()));
    }
    EXPECT_GT(failed, 0);
  }
#endif

  int iterations_;
  std::size_t most_primitives_ = 200;
  Threads threads_{1};
  Scene scene_ = testing::tiny_scene(threads_);
};

}  // namespace splatboost::test
