#include "tools/launcher/page_access.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::launcher {
namespace {

TEST(AListenAddress, IsOneHostsWithAPortOrWithout) {
  EXPECT_EQ(listen_address_from("192.168.1.20")->address, "192.168.1.20");
  EXPECT_EQ(listen_address_from("192.168.1.20")->port, 0);
  EXPECT_EQ(listen_address_from("192.168.1.20:8800")->port, 8800);
  for (const char* wrong : {"", "0.0.0.0", "::", "ground", "192.168.1", "192.168.1.20:", "192.168.1.20:0",
                            "192.168.1.20:65536", "192.168.1.20:88x", "192.168.1.20:999999999999"})
    EXPECT_FALSE(listen_address_from(wrong)) << wrong;
}

TEST(ThePagesCertificate, IsOfItsAddressAndItsKeyIsNobodyElses) {
  const RunFiles files{(std::filesystem::path(testing::TempDir()) / "ledgerline_page_access").string()};
  std::filesystem::create_directories(files.directory);
  ASSERT_TRUE(make_page_certificate(files, "192.168.1.20"));
  const auto pem = read_file(files.in("page.pem"));
  ASSERT_TRUE(pem);
  ASSERT_TRUE(crypto::parse_certificate(*pem));
  const auto shown = fingerprint(*pem);
  ASSERT_TRUE(shown) << shown.error().message;
  EXPECT_EQ(shown->size(), 32U * 3 - 1);
  struct stat info {};
  ASSERT_EQ(::stat(files.in("page.key").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600U);
  std::filesystem::remove_all(files.directory);
  EXPECT_FALSE(fingerprint("nothing"));
}

TEST(TheStationsLink, ReplacesAnEarlierFlightsAndGoesWithItsOwn) {
  const std::string folder = testing::TempDir() + "/ledgerline_station_link/ledgerline";
  const std::string link = folder + "/flight.toml";
  std::filesystem::remove_all(folder);
  ASSERT_TRUE(link_station(folder, "/run/killed/ground.toml"));
  const Status linked = link_station(folder, "/run/one/ground.toml");
  ASSERT_TRUE(linked) << linked.error().message;
  EXPECT_EQ(std::filesystem::read_symlink(link), "/run/one/ground.toml");
  struct stat info {};
  ASSERT_EQ(::stat(folder.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0700U);
  unlink_station(folder, "/run/other/ground.toml");
  EXPECT_TRUE(std::filesystem::is_symlink(link)) << "another flight's";
  unlink_station(folder, "/run/one/ground.toml");
  EXPECT_FALSE(std::filesystem::is_symlink(link));
  EXPECT_FALSE(link_station("/proc/nowhere", "/run/one/ground.toml"));
}

TEST(AQrCode, HasLinesOfOneWidthAndSaysWhatDoesNotFit) {
  const auto code = qr_code("https://192.168.1.20:8800/#token=" + std::string(64, 'a'));
  ASSERT_TRUE(code);
  EXPECT_GT(std::ranges::count(*code, '\n'), 15);
  EXPECT_FALSE(qr_code(std::string(5000, 'a')));
}

}  // namespace
}  // namespace ledgerline::launcher
