// SPDX-License-Identifier: Apache-2.0
#include "families/nets/matrices_cuda.h"

#include <cublas_v2.h>

#include <algorithm>
#include <string>
#include <type_traits>

#include "device/device_view.h"
#include "device/launch.h"
#include "splatboost/device_array.h"
#include "splatboost/errors.h"

#ifndef SPLATBOOST_CUDA_ON_CPU
#include <dlfcn.h>
#endif

namespace splatboost::cuda {
namespace {

/// The cuBLAS functions used here.
struct Cublas {
  decltype(&cublasCreate) create;
  decltype(&cublasDestroy) destroy;
  decltype(&cublasSetStream) set_stream;
  decltype(&cublasSgemm) sgemm;
  decltype(&cublasGetStatusName) status_name;
};

#ifdef SPLATBOOST_CUDA_ON_CPU

Cublas load_cublas() { return {cublasCreate, cublasDestroy, cublasSetStream, cublasSgemm, cublasGetStatusName}; }

#else

Cublas load_cublas() {
  const std::string name = "libcublas.so." + std::to_string(CUBLAS_VER_MAJOR);
  // The library search path first, then the toolkit used in this build.
  void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) library = dlopen((SPLATBOOST_CUDA_LIBRARIES "/" + name).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    throw NoDeviceError("backbones with neural networks need cuBLAS on a GPU, but " + name +
                        " was not found; install it, or add its folder to LD_LIBRARY_PATH");
  }
  const auto find = [&](auto& function, const char* symbol) {
    function = reinterpret_cast<std::remove_reference_t<decltype(function)> >(dlsym(library, symbol));
    if (function == nullptr) throw NoDeviceError(name + " has no function " + symbol + "; install a supported cuBLAS");
  };
  Cublas cublas{};
  find(cublas.create, "cublasCreate_v2");
  find(cublas.destroy, "cublasDestroy_v2");
  find(cublas.set_stream, "cublasSetStream_v2");
  find(cublas.sgemm, "cublasSgemm_v2");
  find(cublas.status_name, "cublasGetStatusName");
  return cublas;
}

#endif

const Cublas& cublas() {
  static const Cublas loaded = load_cublas();
  return loaded;
}

constexpr unsigned kColumns = 32, kRowLanes = 8;  // per block
constexpr std::size_t kMaxRowBlocks = 512;

/// A block sums kColumns columns over every gridDim.x-th group of kRowLanes rows; blocks of equal blockIdx.x write one
/// row of `sums`.
/// @param add whether to add to `sums` instead of overwriting it
__global__ void __launch_bounds__(kColumns* kRowLanes)
    column_sums_kernel(DeviceView<const float> a, std::size_t m, std::size_t width, std::size_t first,
                       std::size_t columns, bool add, DeviceView<float> sums) {
  __shared__ SharedArray<float, kColumns * kRowLanes> lanes;
  const std::size_t column = blockIdx.y * kColumns + threadIdx.x;
  const int at = static_cast<int>(threadIdx.y * kColumns + threadIdx.x);
  float sum = 0;
  for (std::size_t row = blockIdx.x * kRowLanes + threadIdx.y; column < columns && row < m;
       row += static_cast<std::size_t>(gridDim.x) * kRowLanes) {
    sum += a[width * row + first + column];
  }
  lanes.set(at, sum);
  __syncthreads();
  if (threadIdx.y != 0 || column >= columns) return;
  for (int lane = 1; lane < static_cast<int>(kRowLanes); ++lane) {
    sum += lanes.get(lane * static_cast<int>(kColumns) + at);
  }
  float& to = sums[columns * blockIdx.x + column];
  to = add ? to + sum : sum;
}

int whole(std::size_t n) {
  SPLATBOOST_CHECK(n > 0 && n < (std::size_t{1} << 31), "a matrix must have between 1 and 2^31 - 1 rows and columns");
  return static_cast<int>(n);
}

}  // namespace

struct CudaMatrices::State {
  explicit State(CudaStream& on) : stream(on), partial_sums(on) {
    on.begin_launch("cublasCreate");  // on the stream's device
    cublasHandle_t made = nullptr;
    check(cublas().create(&made), "cublasCreate");
    handle.reset(made);
    check(cublas().set_stream(made, static_cast<cudaStream_t>(on.handle())), "cublasSetStream");
  }
  /// Throws DeviceMemoryError if cuBLAS found no memory for its workspace, like allocations of our own.
  void check(cublasStatus_t status, const char* what) const {
    if (status == CUBLAS_STATUS_SUCCESS) return;
    if (status == CUBLAS_STATUS_ALLOC_FAILED) stream.check(cudaErrorMemoryAllocation, what);
    throw DeviceError(std::string(what) + " failed: " + cublas().status_name(status));
  }
  /// cuBLAS is column-major, where a row-major matrix is its transpose: c = op(a)·op(b) is computed as
  /// cᵀ = op(b)ᵀ·op(a)ᵀ.
  void sgemm(cublasOperation_t of_b, cublasOperation_t of_a, std::size_t m, std::size_t n, std::size_t k,
             std::span<const float> b, std::size_t b_width, std::span<const float> a, std::size_t a_width, float beta,
             std::span<float> c) {
    SPLATBOOST_CHECK(a.size() >= m * k && b.size() >= k * n && c.size() >= m * n, "a matrix is too small");
    constexpr float kOne = 1;
    stream.begin_launch("cublasSgemm");
    check(cublas().sgemm(handle.get(), of_b, of_a, whole(n), whole(m), whole(k), &kOne, b.data(), whole(b_width),
                         a.data(), whole(a_width), &beta, c.data(), whole(n)),
          "cublasSgemm");
  }

  CudaStream& stream;
  struct Destroy {
    void operator()(cublasHandle_t made) const { static_cast<void>(cublas().destroy(made)); }
  };
  std::unique_ptr<std::remove_pointer_t<cublasHandle_t>, Destroy> handle;
  DeviceArray<float> partial_sums;  ///< [blocks, columns]
};

CudaMatrices::CudaMatrices(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
CudaMatrices::~CudaMatrices() = default;

void CudaMatrices::multiply(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m,
                            std::size_t n, std::size_t k) {
  state_->sgemm(CUBLAS_OP_N, CUBLAS_OP_N, m, n, k, b, n, a, k, 0, c);
}

void CudaMatrices::multiply_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c,
                                       std::size_t m, std::size_t n, std::size_t k, bool add) {
  state_->sgemm(CUBLAS_OP_T, CUBLAS_OP_N, m, n, k, b, k, a, k, add ? 1 : 0, c);
}

void CudaMatrices::add_product_of_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c,
                                             std::size_t m, std::size_t n, std::size_t k) {
  state_->sgemm(CUBLAS_OP_N, CUBLAS_OP_T, m, n, k, b, n, a, m, 1, c);
}

void CudaMatrices::add_column_sums(std::span<const float> a, std::size_t m, std::size_t width, std::size_t first,
                                   std::span<float> sums) {
  State& s = *state_;
  SPLATBOOST_CHECK(a.size() >= m * width && first + sums.size() <= width, "a matrix is too small");
  const std::size_t columns = sums.size(), blocks = std::min((m + 63) / 64, kMaxRowBlocks);
  s.partial_sums.ensure(blocks * columns);
  const auto run = [&](std::span<const float> from, std::size_t rows, std::size_t of_width, std::size_t from_column,
                       std::size_t row_blocks, bool add, std::span<float> to) {
    const dim3 grid(static_cast<unsigned>(row_blocks), static_cast<unsigned>((columns + kColumns - 1) / kColumns));
    launch(s.stream, "column_sums", column_sums_kernel, grid, dim3(kColumns, kRowLanes), from, rows, of_width,
           from_column, columns, add, to);
  };
  run(a, m, width, first, blocks, false, s.partial_sums.span());
  run(s.partial_sums.span(), blocks, columns, 0, 1, true, sums);
}

}  // namespace splatboost::cuda
