// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "geometry/cuda_ops.h"
#include "geometry/pixels_cuda.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    expose_kernel(DeviceView<const float> render, DeviceView<const float> exposure, DeviceView<float> exposed) {
  const std::size_t k = element_index();
  if (k < exposed.size()) exposed[k] = expf(exposure[0]) * render[k] + exposure[1];
}

// Elements of the workspace: Σ |difference|, Σ sign·render, Σ sign, valid pixels; finally the loss replaces the first.

__global__ void __launch_bounds__(kBlockThreads)
    exposed_sums_kernel(DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                        DeviceView<const std::uint8_t> valid, DeviceView<const float> exposure,
                        DeviceView<double> workspace) {
  const std::size_t k = element_index(), pixels = truth.size() / 3;
  float size = 0, with_render = 0, sign = 0, counts = 0;
  if (k < truth.size() && (valid.empty() || valid[k % pixels] != 0)) {
    const float difference =
        expf(exposure[0]) * render[k] + exposure[1] - static_cast<float>(truth[k]) * (1.0f / 255.0f);
    sign = difference > 0 ? 1.0f : difference < 0 ? -1.0f : 0.0f;
    size = fabsf(difference);
    with_render = sign * render[k];
    counts = k < pixels ? 1.0f : 0.0f;
  }
  add_to_sum(workspace, 0, size);
  add_to_sum(workspace, 1, with_render);
  add_to_sum(workspace, 2, sign);
  add_to_sum(workspace, 3, counts);
}

__global__ void __launch_bounds__(kBlockThreads)
    exposed_gradient_kernel(DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                            DeviceView<const std::uint8_t> valid, DeviceView<const float> exposure, float weight,
                            DeviceView<const double> workspace, DeviceView<float> gradient) {
  const std::size_t k = element_index(), pixels = truth.size() / 3;
  if (k >= truth.size() || (!valid.empty() && valid[k % pixels] == 0)) return;
  const float gain = expf(exposure[0]);
  const float difference = gain * render[k] + exposure[1] - static_cast<float>(truth[k]) * (1.0f / 255.0f);
  const float share = weight / (3.0f * static_cast<float>(workspace[3]));
  gradient[k] += difference > 0 ? share * gain : difference < 0 ? -share * gain : 0.0f;
}

__global__ void exposure_gradient_kernel(DeviceView<const float> exposure, float weight, DeviceView<double> workspace,
                                         DeviceView<float> exposure_gradient) {
  if (workspace[3] == 0) return;
  const double share = static_cast<double>(weight) / (3.0 * workspace[3]);
  exposure_gradient[0] += static_cast<float>(share * static_cast<double>(expf(exposure[0])) * workspace[1]);
  exposure_gradient[1] += static_cast<float>(share * workspace[2]);
  workspace[0] = share * workspace[0];
}

}  // namespace

void expose(std::span<const float> render, std::span<const float> exposure, std::span<float> exposed,
            CudaStream& stream) {
  launch_each(stream, "expose", expose_kernel, exposed.size(), render, exposure, exposed);
}

void add_exposed_l1(std::span<const float> render, const TruthImage& truth, std::span<const float> exposure,
                    float weight, std::span<float> gradient, std::span<float> exposure_gradient,
                    std::span<double> workspace, CudaStream& stream) {
  stream.fill_zero(workspace.data(), workspace.size_bytes());
  launch_each(stream, "exposed_sums", exposed_sums_kernel, render.size(), render, truth.color, truth.valid, exposure,
              workspace);
  launch_each(stream, "exposed_gradient", exposed_gradient_kernel, render.size(), render, truth.color, truth.valid,
              exposure, weight, std::span<const double>(workspace), gradient);
  launch(stream, "exposure_gradient", exposure_gradient_kernel, dim3(1), dim3(1), exposure, weight, workspace,
         exposure_gradient);
}

}  // namespace splatboost::cuda
