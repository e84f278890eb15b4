// All that the two headers include comes first, so that they bring nothing but their own text into the namespace below.
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <type_traits>
#include <utility>

#include "common/rt/clock.hpp"

#include <relacy/relacy.hpp>
#undef new
#undef delete
#undef malloc
#undef calloc
#undef realloc
#undef free
#undef errno
#undef memory_order_relaxed
#undef memory_order_acquire
#undef memory_order_release
#undef memory_order_seq_cst

/// The two lock-free structures under Relacy, a checker of C++'s memory model: it runs the threads of a test in
/// thousands of interleavings, lets each load return whatever the model permits, and finds data races. The headers are
/// the product's own, read into a namespace in which `std::atomic` is the checker's.
namespace model {
namespace std {

using namespace ::std;

constexpr rl::memory_order memory_order_relaxed = rl::mo_relaxed;
constexpr rl::memory_order memory_order_acquire = rl::mo_acquire;
constexpr rl::memory_order memory_order_release = rl::mo_release;
constexpr rl::memory_order memory_order_seq_cst = rl::mo_seq_cst;

template <typename T>
class atomic {
 public:
  atomic(T value) { store(value, rl::mo_relaxed); }
  T load(rl::memory_order order = rl::mo_seq_cst) const { return value_.load(order, $); }
  void store(T value, rl::memory_order order = rl::mo_seq_cst) { value_.store(value, order, $); }
  T exchange(T value, rl::memory_order order = rl::mo_seq_cst) { return value_.exchange(value, order, $); }
  bool compare_exchange_weak(T& seen, T value, rl::memory_order order, rl::memory_order failed) {
    return value_.compare_exchange_weak(seen, value, order, $, failed, $);
  }
  bool compare_exchange_weak(T& seen, T value) { return value_.compare_exchange_weak(seen, value, rl::mo_seq_cst, $); }
  T fetch_sub(T value) { return value_.fetch_sub(value, rl::mo_seq_cst, $); }
  T fetch_or(T value) { return value_.fetch_or(value, rl::mo_seq_cst, $); }
  void wait(T seen) const {
    if (load() == seen) rl::yield(1, $);
  }
  void notify_all() {}

 private:
  rl::atomic<T> value_;
};

// The checker's plain variables, which find races, have constructors.
template <typename T>
constexpr bool is_trivially_copyable_v = true;

}  // namespace std

namespace ledgerline {
using namespace ::ledgerline;
}

#include "common/rt/mailbox.hpp"
#include "common/rt/spsc_ring.hpp"

}  // namespace model

namespace {

/// A number as a plain variable: two threads that touch it without an order between them are a race.
class Element {
 public:
  Element() : Element(0) {}
  explicit Element(unsigned number) { number_($) = number; }
  Element(const Element& other) : Element(other.number()) {}
  Element& operator=(const Element& other) {
    number_($) = other.number();
    return *this;
  }
  unsigned number() const { return number_($); }

 private:
  rl::var<unsigned> number_;
};

constexpr unsigned elements = 5;  // the ring is full, empty, and begins again at its first place

struct Ring : rl::test_suite<Ring, 2> {
  model::ledgerline::SpscRing<Element, 2> ring;

  void thread(unsigned index) {
    for (unsigned i = 0; i < elements;) {
      Element element(i);
      if (index == 0 ? ring.push(element) : ring.pop(element)) {
        RL_ASSERT(element.number() == i);
        ++i;
      } else {
        rl::yield(1, $);
      }
    }
  }
};

struct Box : rl::test_suite<Box, 3> {
  model::ledgerline::Mailbox<Element> box{2};

  void thread(unsigned index) {
    constexpr unsigned each = 2;
    if (index < 2) {
      box.put(Element(10 * index));
      box.put_in_turn(Element(10 * index + 1));
      return;
    }
    unsigned next[2] = {};
    while (next[0] + next[1] < 2 * each) {
      const auto events = box.pop_all();
      for (const Element& event : events) {
        const unsigned from = event.number() / 10;
        RL_ASSERT(from < 2 && event.number() == 10 * from + next[from]);
        ++next[from];
      }
      if (events.empty()) rl::yield(1, $);
    }
  }
};

/// False: the checker found something, and has written which thread did what.
template <typename Test>
bool holds() {
  rl::test_params params;
  params.iteration_count = 20'000;  // each weakened order is found within the first ten
  return rl::simulate<Test>(params);
}

TEST(LockFree, TheRingHasNoRaceAndKeepsItsOrderInWhateverWayTwoThreadsMeet) { EXPECT_TRUE(holds<Ring>()); }

TEST(LockFree, TheMailboxHasNoRaceAndKeepsEachWritersOrderInWhateverWayThreeThreadsMeet) { EXPECT_TRUE(holds<Box>()); }

}  // namespace
