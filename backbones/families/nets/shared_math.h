// SPDX-License-Identifier: Apache-2.0
/// @file Marks formulas that every device shares. Of internal linkage, because some are compiled for
/// several instruction sets.
#pragma once

#ifdef __CUDACC__
#define SPLATBOOST_SHARED_MATH __host__ __device__ static inline
#else
#define SPLATBOOST_SHARED_MATH static inline
#endif
