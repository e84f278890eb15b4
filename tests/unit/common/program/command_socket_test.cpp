#include "common/program/command_socket.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "common/base/file.hpp"
#include "tests/unit/no_files.hpp"
#include "tests/unit/served_socket.hpp"

namespace ledgerline {
namespace {

using testing::HasSubstr;

class CommandSocketTest : public testing::Test {
 protected:
  CommandSocketTest() {
    char name[] = "/tmp/ledgerline-socket-XXXXXX";
    path_ = ::mkdtemp(name);
  }
  ~CommandSocketTest() override {
    ::unlink(in("file").c_str());
    ::rmdir(path_.c_str());
  }
  std::string in(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

bool readable(const pollfd& one) {
  pollfd asked = one;
  return ::poll(&asked, 1, 0) > 0;
}

TEST_F(CommandSocketTest, ThatMayOpenNoMoreFilesWaitsAWhileAndDoesNotSpin) {
  auto socket = CommandSocket::open(in("f.sock"));
  ASSERT_TRUE(socket) << socket.error().message;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  in("f.sock").copy(address.sun_path, sizeof address.sun_path - 1);
  const int client = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const TimeNs now = 5 * ns_per_s;
  std::vector<pollfd> polled;
  socket->add_to(now, polled);
  ASSERT_TRUE(readable(polled[0]));
  polled[0].revents = POLLIN;
  {
    const NoFiles none;
    socket->serve(now, polled, {});
  }
  polled.clear();
  socket->add_to(now + ns_per_ms, polled);
  EXPECT_EQ(polled[0].fd, -1);
  polled.clear();
  socket->add_to(now + ns_per_s, polled);
  EXPECT_TRUE(readable(polled[0]));
  ::close(client);
}

TEST_F(CommandSocketTest, CarriesACommandAndItsAnswerOrError) {
  const std::string path = in("f.sock");
  auto socket = CommandSocket::open(path);
  ASSERT_TRUE(socket) << socket.error().message;
  struct stat mode {};
  ASSERT_EQ(::stat(path.c_str(), &mode), 0);
  EXPECT_EQ(mode.st_mode & 0777, 0600u);
  EXPECT_THAT(CommandSocket::open(path).error().message, HasSubstr("another program's"));
  {
    const ServedSocket served(std::move(*socket), [](const std::string& command) -> Result<std::string> {
      if (command == "bad") return Error{"no such thing"};
      return command == "list" ? std::string("one\ntwo\n") : std::string();
    });
    for (int i = 0; i < 20; ++i) EXPECT_EQ(*send_command(path, "list"), "one\ntwo\n");
    EXPECT_EQ(*send_command(path, "do"), "");
    EXPECT_EQ(send_command(path, "bad").error().message, "no such thing");
    EXPECT_THAT(send_command(path, std::string(1'000, 'x')).error().message, HasSubstr("less than 1000 bytes"));
    EXPECT_THAT(send_command(path, "two\nlines").error().message, HasSubstr("one line"));
  }
  EXPECT_THAT(send_command(path, "list").error().message, HasSubstr("does not answer"));
  EXPECT_NE(::access(path.c_str(), F_OK), 0) << "it removes its socket";
}

TEST_F(CommandSocketTest, SaysWhatIsInTheWay) {
  ASSERT_TRUE(write_file(in("file"), "x"));
  EXPECT_THAT(CommandSocket::open(in(std::string(120, 'x'))).error().message, HasSubstr("at most 107 bytes"));
  EXPECT_THAT(CommandSocket::open(in("file")).error().message, HasSubstr("is no socket"));
  EXPECT_THAT(CommandSocket::open(in("no/such/folder")).error().message, HasSubstr("cannot make the socket"));
}

TEST_F(CommandSocketTest, IsWaitedForNoLongerThanAsked) {
  auto socket = CommandSocket::open(in("f.sock"));
  ASSERT_TRUE(socket) << socket.error().message;
  const TimeNs before = monotonic_ns();
  EXPECT_THAT(send_command(in("f.sock"), "list", 100 * ns_per_ms).error().message, HasSubstr("does not answer"));
  EXPECT_GE(monotonic_ns() - before, 100 * ns_per_ms);
  EXPECT_LT(monotonic_ns() - before, 3 * ns_per_s);
}

}  // namespace
}  // namespace ledgerline
