#include "allocations.h"

#include <cstdlib>
#include <new>

namespace infrasim::testing {

thread_local int allocations_left = -1;

}  // namespace infrasim::testing

// This is a separate file, so that no compiler can remove an allocation together with its release.

void* operator new(std::size_t size) {
  int& left = infrasim::testing::allocations_left;
  if (left == 0) throw std::bad_alloc();
  if (left > 0) --left;
  if (void* const memory = std::malloc(size > 0 ? size : 1)) return memory;
  throw std::bad_alloc();
}

void operator delete(void* memory) noexcept { std::free(memory); }

void operator delete(void* memory, std::size_t /*size*/) noexcept { std::free(memory); }
