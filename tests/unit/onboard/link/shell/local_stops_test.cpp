#include "onboard/link/shell/persistent_state.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "common/base/file.hpp"

namespace ledgerline::link {
namespace {

class LocalStops : public ::testing::Test {
 protected:
  ~LocalStops() override { std::filesystem::remove_all(folder); }
  DroneSet read(const std::vector<DroneSettings>& of) const {
    const auto stopped = LocalStopsFile(file, of).read();
    EXPECT_TRUE(stopped) << stopped.error().message;
    return stopped ? *stopped : DroneSet();
  }
  bool damaged() const {
    LocalStopsFile stops(file, drones);
    const auto stopped = stops.read();
    EXPECT_TRUE(stopped || stopped.error().message.find(file) != std::string::npos);
    return !stopped;
  }
  void keep(const DroneSet& stopped) const {
    LocalStopsFile stops(file, drones);
    (void)stops.read();
    const auto status = stops.store(stopped);
    ASSERT_TRUE(status) << status.error().message;
  }

  const std::string folder = ::testing::TempDir() + "local_stops_test_" + std::to_string(::getpid());
  const std::string file = folder + "/link.stops";
  const std::vector<DroneSettings> drones{{"tello1", 1}, {"tello2", 2}, {"tello16", 16}};
};

TEST_F(LocalStops, AreReadAsTheyWereKept) {
  EXPECT_TRUE(read(drones).none()) << "no file yet";
  for (const DroneSet& stopped : {DroneSet().set(2), DroneSet().set(1).set(16), DroneSet()}) {
    keep(stopped);
    EXPECT_EQ(read(drones), stopped);
  }
  struct stat is {};
  ASSERT_EQ(::stat(file.c_str(), &is), 0);
  EXPECT_EQ(is.st_mode & 0777, 0600U);
  EXPECT_FALSE(std::filesystem::exists(file + ".new"));
}

TEST_F(LocalStops, WithoutAnyNoFileIsMade) {
  keep({});
  EXPECT_FALSE(std::filesystem::exists(file));
}

TEST_F(LocalStops, AreOfNamesAndOneThatThisLinkDoesNotFlyStays) {
  keep(DroneSet().set(1).set(2));
  const std::vector<DroneSettings> others{{"tello2", 7}};
  LocalStopsFile stops(file, others);
  EXPECT_EQ(*stops.read(), DroneSet().set(7));
  ASSERT_TRUE(stops.store({}));
  EXPECT_EQ(read(drones), DroneSet().set(1));
}

TEST_F(LocalStops, WhateverIsWrongWithTheFileIsNoticed) {
  keep(DroneSet().set(1).set(16));
  const std::string whole = *read_file(file);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    ASSERT_TRUE(write_file(file, whole.substr(0, length)));
    EXPECT_TRUE(damaged()) << length;
  }
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const int bit : {1, 4, 64}) {
      std::string changed = whole;
      changed[at] = static_cast<char>(changed[at] ^ bit);
      ASSERT_TRUE(write_file(file, changed));
      EXPECT_TRUE(damaged()) << at;
    }
  }
  ASSERT_TRUE(write_file(file, whole + "x"));
  EXPECT_TRUE(damaged());
  std::filesystem::remove(file);
  std::filesystem::create_directory(file);
  EXPECT_TRUE(damaged());
}

TEST_F(LocalStops, ADamagedFileIsWrittenAgain) {
  std::filesystem::create_directories(folder);
  ASSERT_TRUE(write_file(file, "x"));
  LocalStopsFile stops(file, drones);
  ASSERT_FALSE(stops.read());
  ASSERT_TRUE(stops.store(DroneSet().set(1).set(2).set(16)));
  EXPECT_EQ(read(drones), DroneSet().set(1).set(2).set(16));
}

TEST_F(LocalStops, ThatCannotBeKeptAreReported) {
  LocalStopsFile stops("/proc/no/such", drones);
  (void)stops.read();
  const auto status = stops.store(DroneSet().set(1));
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("/proc/no/such"), std::string::npos);
}

TEST_F(LocalStops, WithoutAFileNobodyRemembers) {
  LocalStopsFile stops("", drones);
  EXPECT_TRUE(stops.read()->none());
  EXPECT_TRUE(stops.store(DroneSet().set(1)));
}

}  // namespace
}  // namespace ledgerline::link
