// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "device/device_view.h"
#include "device/launch.h"
#include "device/run_cub.h"
#include "optim/cuda_ops.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    kept_kernel(DeviceView<const std::uint8_t> removed, DeviceView<std::uint32_t> kept) {
  const std::size_t i = element_index();
  if (i >= kept.size()) return;
  kept[i] = i < removed.size() && removed[i] == 0 ? 1 : 0;  // the last one makes room for the sum of all
}

__global__ void __launch_bounds__(kBlockThreads)
    compact_kernel(DeviceView<const float> from, DeviceView<const std::uint8_t> removed,
                   DeviceView<const std::uint32_t> places, std::size_t width, DeviceView<float> to) {
  const std::size_t i = element_index();
  if (i >= from.size()) return;
  const std::size_t row = i / width;
  if (removed[row] == 0) to[places[row] * width + i % width] = from[i];
}

__global__ void __launch_bounds__(kBlockThreads)
    gather_kernel(DeviceView<const float> from, DeviceView<const std::uint32_t> rows, std::size_t width,
                  DeviceView<float> to) {
  const std::size_t i = element_index();
  if (i >= to.size()) return;
  to[i] = from[rows[i / width] * width + i % width];
}

}  // namespace

void remove_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed) {
  CudaStream& stream = tensor.stream();
  const std::size_t rows = removed.size();
  DeviceArray<std::uint32_t> kept(stream), places(stream);
  kept.ensure(rows + 1);
  places.ensure(rows + 1);
  launch_each(stream, "kept_rows", kept_kernel, rows + 1, removed, kept.span());
  DeviceArray<std::uint8_t> scratch(stream);
  run_cub(stream, scratch, "cub::ExclusiveSum of kept rows", [&](void* memory, std::size_t& bytes) {
    return cub::DeviceScan::ExclusiveSum(memory, bytes, kept.data(), places.data(), static_cast<std::int64_t>(rows + 1),
                                         handle_of(stream));
  });
  std::uint32_t left = 0;
  stream.copy_to_host(&left, places.data() + rows, sizeof left);

  DeviceArray<float> compacted(stream);
  compacted.ensure(left * width);
  launch_each(stream, "compact_rows", compact_kernel, tensor.size(), std::span<const float>(tensor.span()), removed,
              std::span<const std::uint32_t>(places.span()), width, compacted.span());
  tensor = std::move(compacted);
}

void gather_rows(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                 std::span<float> to, CudaStream& stream) {
  launch_each(stream, "gather_rows", gather_kernel, to.size(), from, rows, width, to);
}

void append_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows) {
  const std::size_t before = tensor.size();
  tensor.resize(before + rows.size() * width);
  launch_each(tensor.stream(), "append_rows", gather_kernel, rows.size() * width,
              std::span<const float>(tensor.span().first(before)), rows, width, tensor.span().subspan(before));
}

void reorder_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> order) {
  DeviceArray<float> ordered(tensor.stream());
  ordered.ensure(tensor.size());
  launch_each(tensor.stream(), "reorder_rows", gather_kernel, tensor.size(), std::span<const float>(tensor.span()),
              order, width, ordered.span());
  tensor = std::move(ordered);
}

}  // namespace splatboost::cuda
