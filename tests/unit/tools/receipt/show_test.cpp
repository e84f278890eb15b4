#include "tools/receipt/show.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

/// What a person is shown of a receipt's certificates.
namespace ledgerline::receipt {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Role = fabric::ReceiptProof::Certificate::Role;

constexpr std::int64_t day_s = 86'400, used_s = 20'000 * day_s, valid_to_s = used_s + 10 * day_s;

fabric::ReceiptProof proven_by(Role role) {
  fabric::ReceiptProof proven;
  proven.tx_id = "ab12";
  proven.verdict = "VALID";
  proven.block = 7;
  proven.organisations = 3;
  proven.peers = {{"Org1MSP", "CN=peer0"}, {"Org2MSP", "CN=peer0"}};
  proven.certificates = {{role, {"Org1MSP", "CN=peer0"}, used_s - day_s, valid_to_s, used_s, false}};
  proven.without_list = {"Org1MSP", "Org2MSP"};
  return proven;
}

TEST(ShownReceipt, SaysWhatWasNotLookedAt) {
  const std::string text = words(proven_by(Role::peer), used_s);
  EXPECT_THAT(text,
              HasSubstr("no revocation list was given: whether a certificate has been revoked was not looked at"));
  EXPECT_THAT(text, HasSubstr("certificates: none has expired, each was valid at the claimed times"));
}

TEST(ShownReceipt, SaysWhatHasExpiredAndWhetherItWasValidThen) {
  fabric::ReceiptProof proven = proven_by(Role::peer);
  EXPECT_THAT(words(proven, valid_to_s), HasSubstr("none has expired"));
  EXPECT_THAT(words(proven, valid_to_s + 1),
              HasSubstr("certificate of peer Org1MSP CN=peer0: expired on 2024-10-14T00:00:00Z, "
                        "was valid at 2024-10-04T00:00:00Z, which who asked claims"));
  proven.certificates[0].used_s = valid_to_s + 1;
  proven.certificates[0].role = Role::orderer;
  EXPECT_THAT(words(proven, valid_to_s),
              HasSubstr("certificate of orderer Org1MSP CN=peer0: was not valid at 2024-10-14T00:00:01Z, "
                        "which the creator claims"));
  proven.certificates[0].used_s = INT64_MAX;
  EXPECT_THAT(words(proven, valid_to_s), HasSubstr("was not valid at a time that is none"));
}

TEST(ShownReceipt, SaysWhoIsRevokedAndByWhoseLists) {
  fabric::ReceiptProof proven = proven_by(Role::peer);
  proven.certificates[0].revoked = true;
  proven.revocation_lists = {{"Org1MSP", used_s}};
  proven.without_list = {"Org2MSP"};
  const std::string text = words(proven, used_s);
  EXPECT_THAT(text, HasSubstr("revocation lists that were looked at: Org1MSP's of 2024-10-04T00:00:00Z; "
                              "none was given of: Org2MSP"));
  EXPECT_THAT(text, HasSubstr("certificate of peer Org1MSP CN=peer0: revoked, so its word was not counted"));
  EXPECT_THAT(text, Not(HasSubstr("no revocation list was given")));
  const auto reported = nlohmann::json::parse(json(proven, used_s));
  EXPECT_EQ(reported["certificates"][0]["role"], "peer");
  EXPECT_EQ(reported["certificates"][0]["revoked"], true);
  EXPECT_EQ(reported["certificates"][0]["counted"], false);
  EXPECT_EQ(reported["revocation_lists"][0]["msp_id"], "Org1MSP");
  EXPECT_EQ(reported["without_revocation_list"], nlohmann::json({"Org2MSP"}));
  proven.certificates[0].role = Role::creator;
  EXPECT_THAT(words(proven, used_s), HasSubstr("revoked by now; the peers validated it when the transaction came"));
  EXPECT_EQ(nlohmann::json::parse(json(proven, used_s))["certificates"][0]["counted"], true);
}

TEST(ShownReceipt, SaysWhatTheCallWas) {
  fabric::ReceiptProof proven = proven_by(Role::peer);
  proven.contract = "ledgerline";
  proven.function = "stop";
  proven.arguments = {R"({"drones":["tello1"],"cut":true})"};
  EXPECT_THAT(words(proven, used_s), HasSubstr("stop of ledgerline, arguments: 1, bytes of them: 32\n"
                                               "asked for:\n  drones: tello1\n  cut: true\nendorsed by"));
  EXPECT_EQ(nlohmann::json::parse(json(proven, used_s))["call"]["drones"][0], "tello1");
}

TEST(ShownReceipt, AmongSeveralIsOneLine) {
  EXPECT_EQ(line("a.receipt", proven_by(Role::peer)),
            "a.receipt: proven: transaction ab12 in block 7: VALID, by the word of peers of 2 of 3 organisations");
  const Result<fabric::ReceiptProof> none(Error{"it is no receipt"});
  EXPECT_EQ(line("b.receipt", none), "b.receipt: nothing is proven: it is no receipt");
  const auto reported = nlohmann::json::parse(json_line("b.receipt", none, used_s));
  EXPECT_EQ(reported, (nlohmann::json{{"file", "b.receipt"}, {"proven", false}, {"why", "it is no receipt"}}));
  EXPECT_EQ(nlohmann::json::parse(json_line("a.receipt", proven_by(Role::peer), used_s))["file"], "a.receipt");
}

}  // namespace
}  // namespace ledgerline::receipt
