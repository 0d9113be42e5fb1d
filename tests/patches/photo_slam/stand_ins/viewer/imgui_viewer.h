// SPDX-License-Identifier: Apache-2.0
/// @file Photo-SLAM's viewer, which is not run without a screen.
#pragma once

#include <memory>

class ImGuiViewer {
 public:
  template <class Slam, class Mapper>
  ImGuiViewer(Slam, std::shared_ptr<Mapper>) {}
  void run() {}
};
