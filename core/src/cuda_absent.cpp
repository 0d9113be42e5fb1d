// SPDX-License-Identifier: Apache-2.0
// What a build without CUDA has in place of the .cu files. There is no stream, so nothing else here is ever reached.
#include "cuda_operations.h"
#include "splatboost/cuda_laps.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {
[[noreturn]] void absent() {
  throw NoDeviceError("this build of SplatBoost has no CUDA: build it where nvcc is installed, or use the CPU");
}
}  // namespace

int cuda_device_count() noexcept { return 0; }
const char* cuda_architectures() noexcept { return ""; }
CudaActivity CudaStream::total_activity() noexcept { return {}; }
CudaCall::CudaCall(CudaStream& stream, void*) : stream_(stream) { absent(); }
CudaCall::~CudaCall() = default;

CudaStream::CudaStream(int) { absent(); }
CudaStream::~CudaStream() = default;
std::string CudaStream::device_name() const { absent(); }
std::size_t CudaStream::free_memory() const { absent(); }
void CudaStream::synchronize() { absent(); }
void* CudaStream::allocate(std::size_t) { absent(); }
void CudaStream::release(void*) noexcept {}
void* CudaStream::allocate_pinned(std::size_t) { absent(); }
void CudaStream::release_pinned(void*) noexcept {}
void CudaStream::copy_to_device(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_from_pinned(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_on_device(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_to_host(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_to_pinned(void*, const void*, std::size_t) { absent(); }
void CudaStream::fill_zero(void*, std::size_t) { absent(); }
void CudaStream::make_current() const { absent(); }
void CudaStream::begin_launch(const char*) { absent(); }
void CudaStream::end_launch(int) { absent(); }
void CudaStream::count_synchronization() { absent(); }
void CudaStream::check(int, const char*) const { absent(); }

struct CudaLaps::State {};
CudaLaps::CudaLaps(CudaStream&) { absent(); }
CudaLaps::~CudaLaps() = default;
CudaLaps::CudaLaps(CudaLaps&&) noexcept = default;
CudaLaps& CudaLaps::operator=(CudaLaps&&) noexcept = default;
void CudaLaps::mark(const char*) { absent(); }
std::optional<CudaLaps::Lap> CudaLaps::take() { absent(); }

namespace cuda {
std::unique_ptr<RasterizerBackend> make_rasterizer(CudaStream&) { absent(); }
void exponentials(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void sigmoids(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void sigmoid_gradients(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void scale(std::span<float>, float, CudaStream&) { absent(); }
void multiply(std::span<const float>, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void add_products(std::span<const float>, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void dropout_factors(const RandomStream&, double, float, std::span<float>, CudaStream&) { absent(); }
void add_screen_gradients(const ScreenGradients&, AbsoluteNorm, float, const ScreenGradientSums&, CudaStream&) {
  absent();
}
void mean_screen_gradients(const ScreenGradientSums&, std::span<float>, std::span<float>, CudaStream&) { absent(); }
void longest_scales(std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void smoothing_filters(std::span<const float>, std::span<const Camera>, float, float, std::span<std::uint32_t>,
                       std::span<float>, CudaStream&) {
  absent();
}
void smooth_gaussians(std::span<const float>, std::span<const float>, std::span<const float>, const SmoothedGaussians&,
                      CudaStream&) {
  absent();
}
void smooth_gaussians_backward(std::span<const float>, std::span<const float>, const SmoothedGaussians&,
                               const SmoothedGradients&, std::span<float>, std::span<float>, CudaStream&) {
  absent();
}
void adam_step(std::span<float>, std::span<float>, std::span<float>, std::span<float>, std::int64_t, const AdamOptions&,
               CudaStream&) {
  absent();
}
struct LossesOnTheWay::State {};
LossesOnTheWay::LossesOnTheWay(CudaStream&) { absent(); }
LossesOnTheWay::~LossesOnTheWay() = default;
bool LossesOnTheWay::is_full() const { absent(); }
void LossesOnTheWay::send(const DeviceArray<double>&, float) { absent(); }
std::optional<LossTotals> LossesOnTheWay::take() { absent(); }
LossTotals LossesOnTheWay::wait() { absent(); }
struct PinnedUploads::State {};
PinnedUploads::PinnedUploads(CudaStream&) { absent(); }
PinnedUploads::~PinnedUploads() = default;
void PinnedUploads::upload(std::span<const std::uint8_t>, std::span<const std::uint8_t>, std::uint8_t*) { absent(); }
void photometric(std::span<const float>, const TruthImage&, float, std::span<float>, PhotometricWorkspace&,
                 CudaStream&) {
  absent();
}
ErrorCounts flag_errors(std::span<const float>, const TruthImage&, float, float, std::span<float>,
                        std::span<std::uint8_t>, CudaStream&) {
  absent();
}
void add_view(std::span<const std::int32_t>, double, std::span<std::int64_t>, std::span<double>, CudaStream&) {
  absent();
}
void ssim(const SsimPlanes&, std::span<const float>, std::span<const float>, int, std::span<float>, std::span<double>,
          CudaSsimWorkspace&) {
  absent();
}
void importance_scores(std::span<const std::int64_t>, int, std::span<std::int64_t>, CudaStream&) { absent(); }
void pruning_scores(std::span<const double>, std::span<float>, CudaStream&) { absent(); }
void mark_visible(const Camera&, std::span<const float>, float, std::span<std::uint8_t>, CudaStream&) { absent(); }
void visible_radii(const Camera&, const Gaussians&, const RasterOptions&, std::span<std::int32_t>, CudaStream&) {
  absent();
}
void remove_rows(DeviceArray<float>&, std::size_t, std::span<const std::uint8_t>) { absent(); }
void gather_rows(std::span<const float>, std::size_t, std::span<const std::uint32_t>, std::span<float>, CudaStream&) {
  absent();
}
void append_rows(DeviceArray<float>&, std::size_t, std::span<const std::uint32_t>) { absent(); }
void reorder_rows(DeviceArray<float>&, std::size_t, std::span<const std::uint32_t>) { absent(); }

std::size_t keep_important(std::span<const std::int64_t>, double, std::span<std::uint8_t>, CudaStream&) { absent(); }
void keep_weighted_sample(std::span<const float>, std::size_t, const RandomStream&, std::span<std::uint8_t>,
                          CudaStream&) {
  absent();
}
void keep_largest(std::span<const float>, std::size_t, std::span<std::uint8_t>, CudaStream&) { absent(); }
std::size_t spare_one(std::span<const float>, std::span<std::uint8_t>, CudaStream&) { absent(); }
void spatial_order(std::span<const float>, std::span<std::uint32_t>, CudaStream&) { absent(); }
void mean_squared_neighbor_distances(std::span<const float>, int, std::span<float>, CudaStream&) { absent(); }

}  // namespace cuda

}  // namespace splatboost
