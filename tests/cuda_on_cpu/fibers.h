// SPDX-License-Identifier: Apache-2.0
/// @file Fibers: stacks that a single thread switches between.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

namespace cuda_on_cpu {

/// A stack and the place where its execution stopped. It runs an endless function, which yields by switching back.
class Fiber {
 public:
  /// @param body never returns
  explicit Fiber(std::function<void()> body);
  ~Fiber();
  Fiber(const Fiber&) = delete;
  Fiber& operator=(const Fiber&) = delete;

  /// Called from the main stack: runs the fiber until it yields.
  void resume();
  /// Called from the fiber: yields to the caller of resume().
  void give_way();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

}  // namespace cuda_on_cpu
