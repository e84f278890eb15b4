#include "onboard/shim/mapping.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

#include "common/base/file.hpp"

namespace ledgerline::drone_shim {
namespace {

class ShimMapping : public ::testing::Test {
 protected:
  void TearDown() override { ::unlink(path.c_str()); }
  std::string path = "/dev/shm/ledgerline_shim_test_" + std::to_string(::getpid());
};

TEST_F(ShimMapping, TheDronesEndMakesAFileOfItsUserAloneAndRemovesIt) {
  {
    const auto drones = Mapping::open(path, End::drones);
    ASSERT_TRUE(drones) << drones.error().message;
    struct stat info {};
    ASSERT_EQ(::stat(path.c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 0777U, 0600U);
    EXPECT_FALSE(drones->other_lives());
    {
      const auto link = Mapping::open(path, End::link);
      ASSERT_TRUE(link) << link.error().message;
      EXPECT_TRUE(drones->other_lives());
      EXPECT_TRUE(link->other_lives());
      EXPECT_NE(&link->memory(), &drones->memory());
      link->memory().turns.now_ns = 7;
      EXPECT_EQ(drones->memory().turns.now_ns, 7);
    }
    EXPECT_FALSE(drones->other_lives());
  }
  EXPECT_FALSE(read_file(path));
}

TEST_F(ShimMapping, EachEndIsOfOneProcess) {
  const auto drones = Mapping::open(path, End::drones);
  const auto link = Mapping::open(path, End::link);
  ASSERT_TRUE(drones && link);
  for (const End end : {End::drones, End::link}) {
    const auto second = Mapping::open(path, end);
    ASSERT_FALSE(second);
    EXPECT_NE(second.error().message.find("another process holds"), std::string::npos) << second.error().message;
  }
  EXPECT_TRUE(read_file(path)) << "a second one removed the first one's file";
}

/// A process that holds the drones' end until it is killed.
class Other {
 public:
  explicit Other(const std::string& path) : pid_(::fork()) {
    if (pid_ != 0) return;
    auto drones = Mapping::open(path, End::drones);
    if (!drones) ::_exit(1);
    drones->memory().turns.now_ns = 5;
    while (true) ::pause();
  }
  ~Other() { kill(); }
  void kill() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

 private:
  ::pid_t pid_;
};

TEST_F(ShimMapping, ANewEndJoinsTheOtherAndHearsNothingOfBefore) {
  Other killed(path);
  for (int i = 0; i < 5000 && !Mapping::open(path, End::link); ++i) ::usleep(1000);
  const auto link = Mapping::open(path, End::link);
  ASSERT_TRUE(link) << link.error().message;
  EXPECT_TRUE(link->other_lives());
  for (int i = 0; i < 5000 && link->memory().turns.now_ns != 5; ++i) ::usleep(1000);  // before it is killed
  Datagram said;
  said.assign("takeoff");
  ASSERT_TRUE(link->memory().to_drones.push(said));
  killed.kill();
  EXPECT_FALSE(link->other_lives());

  const auto again = Mapping::open(path, End::drones);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->memory().turns.now_ns, 5) << "another memory than the link's";
  Datagram heard;
  EXPECT_FALSE(again->memory().to_drones.pop(heard)) << "an old take-off";
  said.assign("command");
  ASSERT_TRUE(link->memory().to_drones.push(said));
  ASSERT_TRUE(again->memory().to_drones.pop(heard));
  EXPECT_EQ(heard.view(), "command");
}

TEST_F(ShimMapping, ASimulatorThatEndsUnderALinkLeavesTheFileForTheNextOne) {
  std::optional<Mapping> first(std::move(*Mapping::open(path, End::drones)));
  const auto link = Mapping::open(path, End::link);
  ASSERT_TRUE(link);
  first.reset();
  const auto second = Mapping::open(path, End::drones);
  ASSERT_TRUE(second) << second.error().message;
  second->memory().turns.now_ns = 9;
  EXPECT_EQ(link->memory().turns.now_ns, 9);
}

TEST_F(ShimMapping, BothEndsMustMeanTheSameClock) {
  const auto drones = Mapping::open(path, End::drones, true);
  ASSERT_TRUE(drones);
  const auto link = Mapping::open(path, End::link);
  ASSERT_FALSE(link);
  EXPECT_NE(link.error().message.find("lockstep"), std::string::npos) << link.error().message;
  EXPECT_TRUE(Mapping::open(path, End::link, true));
}

TEST_F(ShimMapping, WithoutALinkAnOldFileIsRecreated) {
  Other killed(path);
  for (int i = 0; i < 5000 && !Mapping::open(path, End::link); ++i) ::usleep(1000);
  killed.kill();
  ASSERT_TRUE(read_file(path)) << "the killed one left nothing behind";
  const auto drones = Mapping::open(path, End::drones);
  ASSERT_TRUE(drones) << drones.error().message;
  EXPECT_EQ(drones->memory().turns.now_ns, 0);
}

TEST_F(ShimMapping, SaysWhatIsWrong) {
  const auto why = [&](const std::string& file, End end) {
    const auto mapping = Mapping::open(file, end);
    return mapping ? std::string("nothing") : mapping.error().message;
  };
  EXPECT_NE(why(path, End::link).find("there is no shim"), std::string::npos);
  EXPECT_NE(why("/proc/shim", End::drones).find("must lie in memory"), std::string::npos);
  EXPECT_NE(why("/dev/shm/nowhere/shim", End::drones).find("cannot tell where it lies"), std::string::npos);

  std::ofstream(path) << "somebody's own notes";
  ASSERT_EQ(::chmod(path.c_str(), 0644), 0);
  EXPECT_NE(why(path, End::drones).find("of this user alone"), std::string::npos);
  EXPECT_NE(why(path, End::link).find("of this user alone"), std::string::npos);
  ASSERT_EQ(::chmod(path.c_str(), 0600), 0);
  EXPECT_NE(why(path, End::drones).find("another file of this name"), std::string::npos);
  EXPECT_EQ(*read_file(path), "somebody's own notes");
  EXPECT_NE(why(path, End::link).find("no shim of this build"), std::string::npos);

  const std::uint64_t other_build = Memory::layout + 1;
  std::ofstream(path).write(reinterpret_cast<const char*>(&other_build), sizeof other_build);
  ASSERT_EQ(::truncate(path.c_str(), sizeof(Memory)), 0);
  EXPECT_NE(why(path, End::link).find("no shim of this build"), std::string::npos);
  EXPECT_TRUE(Mapping::open(path, End::drones)) << "without a link it may be recreated";
}

TEST(ShimDatagram, IsBoundedWhateverTheOtherProcessWrote) {
  Datagram datagram;
  EXPECT_FALSE(datagram.assign(std::string(Datagram::max_bytes + 1, 'x')));
  EXPECT_TRUE(datagram.assign(std::string(Datagram::max_bytes, 'x')));
  datagram.size = 65535;
  EXPECT_EQ(datagram.view().size(), Datagram::max_bytes);
}

}  // namespace
}  // namespace ledgerline::drone_shim
