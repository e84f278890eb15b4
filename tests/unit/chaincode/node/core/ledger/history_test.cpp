#include <gmock/gmock.h>

#include "tests/unit/chaincode/node/core/core_fixture.hpp"

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;

class HistoryTest : public CoreTest {};

TEST_F(HistoryTest, HistoryIsReadFromTheBlocks) {
  for (const char* value : {"one", "two", "three"}) net.submit(net.host, "set", note("tello1/a", value));
  const auto history = [&] {
    protos::Response response;
    EXPECT_TRUE(response.ParseFromString(evaluate("history", "tello1/a").bytes));
    Versions versions;
    EXPECT_TRUE(parse_message(response.payload(), versions).ok());
    std::vector<std::string> values;
    for (const ledgerline::Version& version : versions.versions()) values.push_back(version.asset().msg_data());
    return values;
  };
  EXPECT_THAT(history(), ElementsAre("three", "two", "one"));
  net.restart();
  EXPECT_THAT(history(), ElementsAre("three", "two", "one"));
}

}  // namespace
}  // namespace ledgerline::node
