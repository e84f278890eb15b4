#include <gtest/gtest.h>

#include <atomic>

#include "tests/unit/allocations.hpp"
#include "tests/unit/common/dds/domain.hpp"

namespace ledgerline::dds {
namespace {

TEST(Steady, NeitherPublishingNorHandingOnAllocates) {
  auto says = Participant::create(on_own_domain());
  auto hears = Participant::create(on_own_domain());
  ASSERT_TRUE(says && hears);
  constexpr const char* type = "made_up_msgs/msg/Nested";
  constexpr std::uint32_t warm = 10, messages = 1000;
  std::atomic<std::uint32_t> got{0};
  std::uint64_t at_first = 0, at_last = 0;  // on the thread that delivers; DDS itself is C and does not come by here
  auto r =
      RawReader::create(*hears, "/steady", type, {.depth = 100}, [&](std::span<const std::uint8_t>, const RawInfo&) {
        if (got + 1 == warm) at_first = allocations;
        at_last = allocations;
        ++got;
      });
  auto w = RawWriter::create(*says, "/steady", type, {.depth = 100});
  ASSERT_TRUE(r && w);
  ASSERT_TRUE(eventually([&] { return w->readers() > 0 && r->writers() > 0; }));
  const Bytes message = message_of(56, 1);
  for (std::uint32_t i = 0; i < messages; ++i) ASSERT_TRUE(w->publish(message));
  ASSERT_TRUE(eventually([&] { return got == messages; }));
  EXPECT_GT(at_first, 0u);  // the counter counts
  EXPECT_EQ(at_last, at_first);
}

}  // namespace
}  // namespace ledgerline::dds
