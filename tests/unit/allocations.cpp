#include "tests/unit/allocations.hpp"

#include <cstdlib>
#include <new>

thread_local std::uint64_t ledgerline::allocations = 0;

void* operator new(std::size_t size) {
  ++ledgerline::allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
