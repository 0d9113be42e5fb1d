// SPDX-License-Identifier: Apache-2.0
/// @file Marks formulas shared by all devices. They have internal linkage, because some are compiled for
/// several instruction sets.
#pragma once

#ifdef __CUDACC__
#define SPLATBOOST_SHARED_MATH __host__ __device__ static inline
#else
#define SPLATBOOST_SHARED_MATH static inline
#endif
