// SPDX-License-Identifier: Apache-2.0
/// @file A stub of Photo-SLAM's viewer, which the tests do not run.
#pragma once

#include <memory>

class ImGuiViewer {
 public:
  template <class Slam, class Mapper>
  ImGuiViewer(Slam, std::shared_ptr<Mapper>) {}
  void run() {}
};
