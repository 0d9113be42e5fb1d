// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "loss/cuda_ops.h"
#include "loss/error_map_math.h"

namespace splatboost::cuda {
namespace {

/// Intermediate results of the kernels of one view. Errors are not negative, so their bits compare as integers.
struct ErrorStatistics {
  unsigned low_bits, high_bits;
  unsigned flagged, valid, covered;
};

__global__ void begin_kernel(DeviceView<ErrorStatistics> statistics) { statistics[0] = {0xffffffffu, 0u, 0u, 0u, 0u}; }

__global__ void __launch_bounds__(kBlockThreads)
    errors_kernel(DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                  DeviceView<const std::uint8_t> valid, DeviceView<float> error,
                  DeviceView<ErrorStatistics> statistics) {
  const std::size_t p = element_index(), pixels = error.size();
  const bool inside = p < pixels;
  const bool counts = inside && (valid.empty() || valid[p] != 0);
  float e = 0;
  if (inside) {
    e = pixel_error(render, truth, p, pixels);
    error[p] = e;
  }
  const bool known = counts && e == e;  // NaN is neither smallest nor largest
  unsigned low = known ? __float_as_uint(e) : 0xffffffffu, high = known ? __float_as_uint(e) : 0u;
  for (int step = 16; step > 0; step /= 2) {
    const unsigned other_low = __shfl_xor_sync(0xffffffffu, low, step);
    const unsigned other_high = __shfl_xor_sync(0xffffffffu, high, step);
    low = other_low < low ? other_low : low;
    high = other_high > high ? other_high : high;
  }
  ErrorStatistics& s = statistics[0];
  if (threadIdx.x % 32 == 0) {
    atomicMin(&s.low_bits, low);
    atomicMax(&s.high_bits, high);
  }
  count_lanes(counts, &s.valid);
  count_lanes(counts && e > kNoError, &s.covered);
}

__global__ void __launch_bounds__(kBlockThreads)
    flags_kernel(DeviceView<const float> error, DeviceView<const std::uint8_t> valid, float tau,
                 DeviceView<std::uint8_t> flagged, DeviceView<ErrorStatistics> statistics) {
  const std::size_t p = element_index();
  ErrorStatistics& s = statistics[0];
  const float low = __uint_as_float(s.low_bits), high = __uint_as_float(s.high_bits);
  bool flag = false;
  // If no error was found, low is still the bits of a NaN: the comparison fails and nothing is flagged.
  if (p < flagged.size()) {
    const bool counts = valid.empty() || valid[p] != 0;
    flag = counts && error[p] - low > flag_threshold(low, high, tau);
    flagged[p] = flag ? 1 : 0;
  }
  count_lanes(flag, &s.flagged);
}

}  // namespace

ErrorCounts flag_errors(std::span<const float> render, const TruthImage& truth, float tau, std::span<float> error,
                        std::span<std::uint8_t> flagged, CudaStream& stream) {
  DeviceArray<ErrorStatistics> statistics(stream);
  statistics.ensure(1);
  launch(stream, "errors_begin", begin_kernel, dim3(1), dim3(1), statistics.span());
  launch_each(stream, "errors", errors_kernel, error.size(), render, truth.color, truth.valid, error,
              statistics.span());
  launch_each(stream, "error_flags", flags_kernel, error.size(), std::span<const float>(error), truth.valid, tau,
              flagged, statistics.span());
  const ErrorStatistics found = statistics.to_host()[0];
  return {found.flagged, found.valid, found.covered};
}

}  // namespace splatboost::cuda
