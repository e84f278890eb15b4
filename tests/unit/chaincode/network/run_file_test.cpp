#include "chaincode/network/network.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace ledgerline::network {
namespace {

class RunFileTest : public testing::Test {
 protected:
  RunFileTest() { EXPECT_NE(::mkdtemp(dir.data()), nullptr); }
  ~RunFileTest() override { std::filesystem::remove_all(dir); }
  std::string dir = testing::TempDir() + "ledgerline_run_XXXXXX";
};

TEST_F(RunFileTest, TellsOfANetworkAsLongAsItsProcessHoldsIt) {
  {
    RunFile own(dir);
    ASSERT_TRUE(own.lock());
    EXPECT_EQ(RunFile(dir).read(), nlohmann::json::object()) << "it is starting";
    ASSERT_TRUE(own.write(R"({"ready":true,"long":"text"})"));
    ASSERT_TRUE(own.write(R"({"ready":true})"));
    EXPECT_EQ(RunFile(dir).read(), (nlohmann::json{{"ready", true}}));
  }
  EXPECT_EQ(RunFile(dir).read(), std::nullopt) << "the file is still there, its process is gone";
}

TEST_F(RunFileTest, IsTakenByOneAlone) {
  RunFile own(dir), other(dir);
  EXPECT_EQ(other.read(), std::nullopt);
  ASSERT_TRUE(own.lock());
  EXPECT_FALSE(other.lock());
}

}  // namespace
}  // namespace ledgerline::network
