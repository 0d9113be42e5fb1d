// SPDX-License-Identifier: Apache-2.0
#include "fibers.h"

#include <cstdint>
#include <cstdlib>
#include <utility>

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/common_interface_defs.h>
#endif
#if !defined(__x86_64__)
#include <ucontext.h>
#endif

namespace cuda_on_cpu {
namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr std::size_t kStackBytes = 512 << 10;
#else
constexpr std::size_t kStackBytes = 128 << 10;
#endif

/// The fiber that is being entered for the first time.
Fiber* entered = nullptr;

}  // namespace

#if defined(__x86_64__)

// Saves the callee-saved registers and the stack pointer, and restores those of another stack. Used instead of
// swapcontext(), which also makes a system call.
extern "C" void splatboost_switch_stack(void** save, void* to);
asm(R"(
.text
.globl splatboost_switch_stack
.type splatboost_switch_stack, @function
splatboost_switch_stack:
  pushq %rbp
  pushq %rbx
  pushq %r12
  pushq %r13
  pushq %r14
  pushq %r15
  movq %rsp, (%rdi)
  movq %rsi, %rsp
  popq %r15
  popq %r14
  popq %r13
  popq %r12
  popq %rbx
  popq %rbp
  ret
.size splatboost_switch_stack, .-splatboost_switch_stack
)");

#endif

struct Fiber::Context {
  std::function<void()> body;
  std::unique_ptr<std::byte[]> stack{new std::byte[kStackBytes]};  // uninitialized: unused pages stay untouched
#if defined(__x86_64__)
  void* own = nullptr;   ///< stack pointer of the fiber while it waits
  void* main = nullptr;  ///< stack pointer of the caller of resume()
#else
  ucontext_t own{};
  ucontext_t main{};
#endif
#if defined(__SANITIZE_ADDRESS__)
  void* own_frames = nullptr;
  void* main_frames = nullptr;
  const void* main_stack = nullptr;
  std::size_t main_size = 0;
#endif

  void arrived() {
#if defined(__SANITIZE_ADDRESS__)
    __sanitizer_finish_switch_fiber(own_frames, &main_stack, &main_size);
#endif
  }
  static void enter() {
    Context& context = *entered->context_;
    context.arrived();
    context.body();
    std::abort();  // a body never returns
  }
};

Fiber::Fiber(std::function<void()> body) : context_(std::make_unique<Context>()) {
  context_->body = std::move(body);
#if defined(__x86_64__)
  auto top = reinterpret_cast<std::uintptr_t>(context_->stack.get() + kStackBytes) & ~std::uintptr_t{15};
  auto* at = reinterpret_cast<void**>(top);
  *--at = nullptr;  // where a return address would be
  *--at = reinterpret_cast<void*>(&Context::enter);
  for (int k = 0; k < 6; ++k) *--at = nullptr;
  context_->own = at;
#else
  getcontext(&context_->own);
  context_->own.uc_stack.ss_sp = context_->stack.get();
  context_->own.uc_stack.ss_size = kStackBytes;
  makecontext(&context_->own, &Context::enter, 0);
#endif
}

Fiber::~Fiber() = default;

void Fiber::resume() {
  entered = this;
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_start_switch_fiber(&context_->main_frames, context_->stack.get(), kStackBytes);
#endif
#if defined(__x86_64__)
  splatboost_switch_stack(&context_->main, context_->own);
#else
  swapcontext(&context_->main, &context_->own);
#endif
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_finish_switch_fiber(context_->main_frames, nullptr, nullptr);
#endif
}

void Fiber::give_way() {
#if defined(__SANITIZE_ADDRESS__)
  __sanitizer_start_switch_fiber(&context_->own_frames, context_->main_stack, context_->main_size);
#endif
#if defined(__x86_64__)
  splatboost_switch_stack(&context_->own, context_->main);
#else
  swapcontext(&context_->own, &context_->main);
#endif
  context_->arrived();
}

}  // namespace cuda_on_cpu
