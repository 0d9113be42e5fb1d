// SPDX-License-Identifier: Apache-2.0
/// @file Marks the inline formulas that CPU and CUDA share.
#pragma once

#ifdef __CUDACC__
#define SPLATBOOST_HOST_DEVICE __host__ __device__ inline
#else
#define SPLATBOOST_HOST_DEVICE inline
#endif
