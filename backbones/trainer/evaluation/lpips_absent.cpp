// SPDX-License-Identifier: Apache-2.0
// Replaces lpips.cpp in a build without OpenCV.
#include "trainer/evaluation/metrics.h"
#include "trainer/support/input_error.h"

namespace splatboost {

struct Lpips::Network {};

Lpips::Lpips(const std::filesystem::path&) {
  throw InputError("LPIPS needs OpenCV, which this build does not have; omit --lpips");
}

Lpips::~Lpips() = default;

double Lpips::distance(std::span<const float>, const TruthImage&) { return 0; }  // never called: the constructor throws
void Lpips::release_memory() {}

}  // namespace splatboost
