#include "chaincode/network/options.hpp"

#include <sys/socket.h>

#include "tests/unit/chaincode/network/setup/fake_tools.hpp"

namespace ledgerline::network {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST(PlacesTest, AreKeptByTheDirectory) {
  const FakeTools tools;
  Options options = tools.options();
  const auto first = choose_listen_addresses(options);
  ASSERT_TRUE(first.ok());
  EXPECT_EQ(first->organisations.size(), 3U);
  EXPECT_EQ(*choose_listen_addresses(options), *first);
  options.orderers = 3;
  EXPECT_THAT(choose_listen_addresses(options).error().message, HasSubstr("is of a network with other addresses"));
  options.orderers = 1;
  options.ca = true;
  EXPECT_THAT(choose_listen_addresses(options).error().message, HasSubstr("is of a network without fabric-ca"));
}

TEST(PlacesTest, AFileThatIsDamagedIsReported) {
  const FakeTools tools;
  for (const char* text : {"{", "{}", "[1]", R"({"orderers": ["x"], "organisations": [], "authorities": []})"}) {
    ASSERT_TRUE(write_file(tools.options().dir + "/places.json", text, 0644).ok());
    const auto addresses = choose_listen_addresses(tools.options());
    ASSERT_FALSE(addresses) << text;
    EXPECT_THAT(addresses.error().message, HasSubstr("places.json: "));
  }
}

TEST(PlacesTest, OneThatIsTakenIsNamedAndNotChosen) {
  const int taken = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in at = ListenAddress{"127.0.0.1", 0}.address();
  socklen_t size = sizeof at;
  ASSERT_EQ(::bind(taken, reinterpret_cast<const sockaddr*>(&at), size), 0);
  ASSERT_EQ(::listen(taken, 1), 0);
  ASSERT_EQ(::getsockname(taken, reinterpret_cast<sockaddr*>(&at), &size), 0);
  const ListenAddress address{"127.0.0.1", ntohs(at.sin_port)};
  const Status free = check_free({address});
  ::close(taken);
  ASSERT_FALSE(free);
  EXPECT_THAT(free.error().message, AllOf(HasSubstr("TCP " + address.text()), HasSubstr("is taken")));
  EXPECT_TRUE(check_free({address}).ok());
}

}  // namespace
}  // namespace ledgerline::network
