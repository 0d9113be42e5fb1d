/* SPDX-License-Identifier: Apache-2.0 */
/** @file Checks and tensors for the tests in C. */
#ifndef SPLATBOOST_TESTS_C_API_CHECKS_H_
#define SPLATBOOST_TESTS_C_API_CHECKS_H_

#include <splatboost/c_api.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

/* The tests run twice: on the CPU, and on CUDA as the emulator has it, whose device memory is the host's. */
#ifdef SPLATBOOST_TEST_ON_CUDA
enum { TEST_KIND = SB_CUDA, OTHER_KIND = SB_CPU };
static const sb_device cuda_device = {SB_CUDA, 0, 0, NULL};
#define TEST_DEVICE (&cuda_device)
#else
enum { TEST_KIND = SB_CPU, OTHER_KIND = SB_CUDA };
#define TEST_DEVICE NULL
#endif

static int failures = 0;

#define CHECK(condition)                                                                               \
  do {                                                                                                 \
    if (!(condition)) {                                                                                \
      ++failures;                                                                                      \
      printf("%s:%d: %s is false; last error: %s\n", __FILE__, __LINE__, #condition, sb_last_error()); \
    }                                                                                                  \
  } while (0)

#define CHECK_NEAR(a, b, tolerance)                                                                        \
  do {                                                                                                     \
    const double a_ = (a), b_ = (b);                                                                       \
    if (!(fabs(a_ - b_) <= (tolerance))) {                                                                 \
      ++failures;                                                                                          \
      printf("%s:%d: %s is %.9g, not %.9g ± %.2g\n", __FILE__, __LINE__, #a, a_, b_, (double)(tolerance)); \
    }                                                                                                      \
  } while (0)

/** A dense tensor on the tested device; sizes that are 0 or beyond the dimensions are not read. */
static inline sb_tensor tensor(void* data, int32_t type, int32_t dimensions, int64_t a, int64_t b, int64_t c) {
  sb_tensor t;
  int64_t stride = 1;
  int d;
  memset(&t, 0, sizeof t);
  t.data = data;
  t.type = type;
  t.dimensions = dimensions;
  t.shape[0] = a;
  t.shape[1] = b;
  t.shape[2] = c;
  for (d = dimensions - 1; d >= 0; --d) {
    t.strides[d] = stride;
    stride *= t.shape[d];
  }
  t.device_kind = TEST_KIND;
  return t;
}

static inline sb_tensor floats(float* data, int32_t dimensions, int64_t a, int64_t b, int64_t c) {
  return tensor(data, SB_FLOAT32, dimensions, a, b, c);
}

/** Looks along +z from the origin; the principal point lies on the centre of pixel (16, 12). */
static inline sb_camera test_camera(void) {
  sb_camera camera;
  int i;
  memset(&camera, 0, sizeof camera);
  camera.width = 33;
  camera.height = 25;
  camera.fx = camera.fy = 32;
  camera.cx = 16.5f;
  camera.cy = 12.5f;
  for (i = 0; i < 4; ++i) camera.camera_from_world[5 * i] = 1;
  return camera;
}

#endif
