#include "common/base/file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace ledgerline {
namespace {

using testing::ContainsRegex;

TEST(Space, AFileTakesWholeBlocksAndAMissingDirectoryNothing) {
  const std::string dir = testing::TempDir() + "ledgerline_space_" + std::to_string(::getpid());
  EXPECT_EQ(bytes_below(dir), 0U);
  std::filesystem::create_directories(dir + "/deep/er");
  const std::uint64_t before = bytes_below(dir);
  std::ofstream(dir + "/deep/er/file") << std::string(100'000, 'x');
  const std::uint64_t grown = bytes_below(dir) - before;
  EXPECT_GE(grown, 100'000U);
  EXPECT_LT(grown, 200'000U);
  std::filesystem::remove_all(dir);
}

TEST(Space, APlaceThatIsNotMadeYetHasTheRoomOfItsFolder) {
  const auto here = space_at("."), later = space_at("./not/yet/made");
  ASSERT_TRUE(here.ok() && later.ok());
  const double ratio =
      static_cast<double>(later->available) / static_cast<double>(here->available);  // others write meanwhile
  EXPECT_NEAR(ratio, 1, 0.1);
}

TEST(Space, TooLittleIsRefusedWithThePlaceAndBothFigures) {
  EXPECT_TRUE(check_space(".", 0, "a flight").ok());
  const Status status = check_space("./not/yet/made", 1'000'000'000'000'000'000, "a flight");
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message,
              ContainsRegex("^\\./not/yet/made has [0-9]+ MB free, and a flight needs 1000000000000 MB"));
}

}  // namespace
}  // namespace ledgerline
