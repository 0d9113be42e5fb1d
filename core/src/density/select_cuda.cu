// SPDX-License-Identifier: Apache-2.0
#include "density/cuda_ops.h"
#include "density/select_math.h"
#include "device/device_view.h"
#include "device/launch.h"
#include "device/run_cub.h"
#include "splatboost/device_array.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    important_kernel(DeviceView<const std::int64_t> importance, double threshold, DeviceView<std::uint8_t> candidates,
                     DeviceView<unsigned> kept) {
  const std::size_t i = element_index();
  bool stays = false;
  if (i < candidates.size()) {
    stays = is_important(candidates[i], importance[i], threshold);
    candidates[i] = stays ? 1 : 0;
  }
  count_lanes(stays, &kept[0]);
}

/// Elements that are not candidates sort after all that are; it does not matter whether they are kept.
__global__ void __launch_bounds__(kBlockThreads)
    sample_keys_kernel(DeviceView<const float> weights, RandomStream random, DeviceView<const std::uint8_t> candidates,
                       DeviceView<double> keys, DeviceView<std::uint32_t> indices) {
  const std::size_t i = element_index();
  if (i >= keys.size()) return;
  keys[i] = candidates[i] != 0 ? sample_key(weights[i], random.uniform(i)) : kNoCandidate;
  indices[i] = static_cast<std::uint32_t>(i);
}

__global__ void __launch_bounds__(kBlockThreads)
    priority_keys_kernel(DeviceView<const float> priorities, DeviceView<const std::uint8_t> candidates,
                         DeviceView<double> keys, DeviceView<std::uint32_t> indices) {
  const std::size_t i = element_index();
  if (i >= keys.size()) return;
  const double key = priority_key(priorities[i]);
  keys[i] = candidates[i] == 0 ? kNoCandidate : key == 0 ? 0.0 : key;  // zeros of either sign are equal
  indices[i] = static_cast<std::uint32_t>(i);
}

__global__ void __launch_bounds__(kBlockThreads)
    drop_kernel(DeviceView<const std::uint32_t> ranked, std::size_t keep, DeviceView<std::uint8_t> candidates) {
  const std::size_t place = element_index();
  if (place >= keep && place < ranked.size()) candidates[ranked[place]] = 0;
}

struct Keys {
  DeviceArray<double> keys;
  DeviceArray<std::uint32_t> indices;
  Keys(CudaStream& stream, std::size_t n) : keys(stream), indices(stream) {
    keys.ensure(n);
    indices.ensure(n);
  }
};

/// Keeps the `keep` candidates with the smallest keys; the sort is stable, so equal keys are ordered by index.
void keep_smallest(Keys& ranked, std::size_t keep, std::span<std::uint8_t> candidates, CudaStream& stream) {
  const std::size_t n = candidates.size();
  Keys sorted(stream, n);
  DeviceArray<std::uint8_t> scratch(stream);
  run_cub(stream, scratch, "cub::SortPairs by priority", [&](void* memory, std::size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(memory, bytes, ranked.keys.data(), sorted.keys.data(), ranked.indices.data(),
                                           sorted.indices.data(), static_cast<std::int64_t>(n), 0, 64,
                                           handle_of(stream));
  });
  launch_each(stream, "drop", drop_kernel, n, std::span<const std::uint32_t>(sorted.indices.span()), keep, candidates);
}

__global__ void __launch_bounds__(kBlockThreads)
    removed_kernel(DeviceView<const float> priorities, DeviceView<const std::uint8_t> removals,
                   DeviceView<unsigned> removed, DeviceView<unsigned long long> best) {
  const std::size_t i = element_index();
  const bool goes = i < removals.size() && removals[i] != 0;
  count_lanes(goes, &removed[0]);
  if (i >= removals.size()) return;
  // The largest priority, ties to the lowest index, as one number.
  const float priority = priorities[i] == 0 ? 0.0f : priorities[i];
  const unsigned bits = __float_as_uint(priority);
  const unsigned ordered = (bits & 0x80000000u) != 0 ? ~bits : bits | 0x80000000u;
  atomicMax(&best[0], static_cast<unsigned long long>(ordered) << 32 | (0xffffffffu - static_cast<unsigned>(i)));
}

__global__ void spare_kernel(DeviceView<const unsigned long long> best, DeviceView<std::uint8_t> removals) {
  removals[0xffffffffu - static_cast<unsigned>(best[0])] = 0;
}

std::size_t number_of(const DeviceArray<unsigned>& count) { return count.to_host()[0]; }

}  // namespace

std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates, CudaStream& stream) {
  DeviceArray<unsigned> kept(stream);
  kept.ensure(1);
  kept.fill_zero();
  launch_each(stream, "keep_important", important_kernel, candidates.size(), importance, threshold, candidates,
              kept.span());
  return number_of(kept);
}

void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates, CudaStream& stream) {
  if (candidates.size() <= keep) return;
  Keys keys(stream, candidates.size());
  launch_each(stream, "sample_keys", sample_keys_kernel, candidates.size(), weights, random,
              std::span<const std::uint8_t>(candidates), keys.keys.span(), keys.indices.span());
  keep_smallest(keys, keep, candidates, stream);
}

void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates,
                  CudaStream& stream) {
  if (candidates.size() <= keep) return;
  Keys keys(stream, candidates.size());
  launch_each(stream, "priority_keys", priority_keys_kernel, candidates.size(), priorities,
              std::span<const std::uint8_t>(candidates), keys.keys.span(), keys.indices.span());
  keep_smallest(keys, keep, candidates, stream);
}

std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals, CudaStream& stream) {
  DeviceArray<unsigned> removed(stream);
  DeviceArray<unsigned long long> best(stream);
  removed.ensure(1);
  removed.fill_zero();
  best.ensure(1);
  best.fill_zero();
  launch_each(stream, "count_removals", removed_kernel, removals.size(), priorities,
              std::span<const std::uint8_t>(removals), removed.span(), best.span());
  const std::size_t count = number_of(removed);
  if (removals.empty() || count < removals.size()) return count;
  launch(stream, "spare", spare_kernel, dim3(1), dim3(1), std::span<const unsigned long long>(best.span()), removals);
  return count - 1;
}

}  // namespace splatboost::cuda
