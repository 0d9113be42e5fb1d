// SPDX-License-Identifier: Apache-2.0
/// @file Fibers: stacks that one thread runs in turn.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

namespace cuda_on_cpu {

/// A stack and the place where it stopped. It runs an endless function, which gives way by switching back.
class Fiber {
 public:
  /// @param body never returns
  explicit Fiber(std::function<void()> body);
  ~Fiber();
  Fiber(const Fiber&) = delete;
  Fiber& operator=(const Fiber&) = delete;

  /// From the main stack: runs the fiber until it gives way.
  void resume();
  /// From the fiber: goes on where resume() was called.
  void give_way();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

}  // namespace cuda_on_cpu
