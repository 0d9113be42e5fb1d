// SPDX-License-Identifier: Apache-2.0
#include "anchors/matrices_cuda.h"

#include <cublas_v2.h>

#include <string>
#include <type_traits>

#include "device_view.h"
#include "launch.h"
#include "splatboost/device_array.h"
#include "splatboost/errors.h"

#ifndef SPLATBOOST_CUDA_ON_CPU
#include <dlfcn.h>
#endif

namespace splatboost::cuda {
namespace {

/// The functions of cuBLAS that are used here.
struct Cublas {
  decltype(&cublasCreate) create;
  decltype(&cublasDestroy) destroy;
  decltype(&cublasSetStream) set_stream;
  decltype(&cublasSgemm) sgemm;
  decltype(&cublasSgemv) sgemv;
};

#ifdef SPLATBOOST_CUDA_ON_CPU

Cublas load_cublas() { return {cublasCreate, cublasDestroy, cublasSetStream, cublasSgemm, cublasSgemv}; }

#else

Cublas load_cublas() {
  const std::string name = "libcublas.so." + std::to_string(CUBLAS_VER_MAJOR);
  // Where the system looks for libraries, or else in the toolkit that this was built with.
  void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) library = dlopen((SPLATBOOST_CUDA_LIBRARIES "/" + name).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    throw NoDeviceError("the nets of anchors need cuBLAS on a GPU, and there is no " + name +
                        ": install it, or put its folder into LD_LIBRARY_PATH");
  }
  const auto find = [&](auto& function, const char* symbol) {
    function = reinterpret_cast<std::remove_reference_t<decltype(function)> >(dlsym(library, symbol));
    if (function == nullptr) throw NoDeviceError(name + " has no " + symbol + ": it is not a cuBLAS that works here");
  };
  Cublas cublas{};
  find(cublas.create, "cublasCreate_v2");
  find(cublas.destroy, "cublasDestroy_v2");
  find(cublas.set_stream, "cublasSetStream_v2");
  find(cublas.sgemm, "cublasSgemm_v2");
  find(cublas.sgemv, "cublasSgemv_v2");
  return cublas;
}

#endif

const Cublas& cublas() {
  static const Cublas loaded = load_cublas();
  return loaded;
}

__global__ void __launch_bounds__(kBlockThreads) ones_kernel(DeviceView<float> values) {
  const std::size_t i = element_index();
  if (i < values.size()) values[i] = 1.0f;
}

int whole(std::size_t n) {
  SPLATBOOST_CHECK(n > 0 && n < (std::size_t{1} << 31), "a matrix must have between 1 and 2^31 - 1 rows and columns");
  return static_cast<int>(n);
}

}  // namespace

struct CudaMatrices::State {
  explicit State(CudaStream& on) : stream(on), ones(on) {
    on.begin_launch("cublasCreate");  // on the stream's device
    cublasHandle_t made = nullptr;
    check(cublas().create(&made), "cublasCreate");
    handle.reset(made);
    check(cublas().set_stream(made, static_cast<cudaStream_t>(on.handle())), "cublasSetStream");
  }
  static void check(cublasStatus_t status, const char* what) {
    if (status == CUBLAS_STATUS_SUCCESS) return;
    throw DeviceError(std::string(what) + " failed: cuBLAS status " + std::to_string(static_cast<int>(status)));
  }
  /// A row-major matrix is the transposed one in the order of columns that cuBLAS knows: c = op(a)·op(b) is asked for
  /// as cᵀ = op(b)ᵀ·op(a)ᵀ.
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
  DeviceArray<float> ones;
};

CudaMatrices::CudaMatrices(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
CudaMatrices::~CudaMatrices() = default;

void CudaMatrices::multiply(std::span<const float> a, std::span<const float> b, std::span<float> c, std::size_t m,
                            std::size_t n, std::size_t k) {
  state_->sgemm(CUBLAS_OP_N, CUBLAS_OP_N, m, n, k, b, n, a, k, 0, c);
}

void CudaMatrices::multiply_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c,
                                       std::size_t m, std::size_t n, std::size_t k) {
  state_->sgemm(CUBLAS_OP_T, CUBLAS_OP_N, m, n, k, b, k, a, k, 0, c);
}

void CudaMatrices::add_product_of_transposed(std::span<const float> a, std::span<const float> b, std::span<float> c,
                                             std::size_t m, std::size_t n, std::size_t k) {
  state_->sgemm(CUBLAS_OP_N, CUBLAS_OP_T, m, n, k, b, n, a, m, 1, c);
}

void CudaMatrices::add_column_sums(std::span<const float> a, std::size_t m, std::size_t width, std::size_t first,
                                   std::span<float> sums) {
  State& s = *state_;
  SPLATBOOST_CHECK(a.size() >= m * width && first + sums.size() <= width, "a matrix is too small");
  if (s.ones.size() < m) {
    s.ones.ensure(m);
    launch_each(s.stream, "ones", ones_kernel, s.ones.size(), s.ones.span());
  }
  constexpr float kOne = 1;
  s.stream.begin_launch("cublasSgemv");
  State::check(cublas().sgemv(s.handle.get(), CUBLAS_OP_N, whole(sums.size()), whole(m), &kOne, a.data() + first,
                              whole(width), s.ones.data(), 1, &kOne, sums.data(), 1),
               "cublasSgemv");
}

}  // namespace splatboost::cuda
