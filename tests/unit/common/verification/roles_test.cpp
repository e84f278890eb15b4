#include "common/verification/control_records.hpp"

#include <gmock/gmock.h>

#include "common/access/access.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

/// Roles as agent and ground know them: whatever one organisation does with its own, the others' are there.
namespace ledgerline::verification {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

/// A ledger that has nothing but roles, and answers a hundred a page.
class RoleLedger {
 public:
  void add_table(const std::string& msp_id, char digit, const std::vector<std::pair<std::string, Role>>& roles) {
    RoleTable table;
    for (const auto& [subject, role] : roles) {
      table.add_entries()->set_subject(subject);
      table.mutable_entries()->rbegin()->set_role(role);
    }
    records_["role/" + msp_id + "/" + digit] = table.SerializeAsString();
  }
  /// As the version before kept it.
  void add_before(const std::string& msp_id, const std::string& subject, Role role) {
    EnrollCall record;
    *record.mutable_identity() = to_message({msp_id, subject});
    record.set_role(role);
    records_["role/" + crypto::hex(crypto::sha256(msp_id + "\n" + subject))] = record.SerializeAsString();
  }
  void add(const std::string& id, const std::string& data) { records_[id] = data; }
  Evaluate evaluate() {
    return [this](const fabric::Call& call) -> Result<std::string> {
      ++asked;
      QueryCall query;
      EXPECT_TRUE(parse_message(call.args[0], query));
      const std::string prefix = query.id().substr(0, query.id().size() - 1);
      Assets page;
      for (auto it = records_.upper_bound(std::max(prefix, query.bookmark())); it != records_.end(); ++it) {
        if (!it->first.starts_with(prefix)) break;
        if (page.assets_size() == 100) {
          page.set_bookmark(page.assets(99).id());
          break;
        }
        page.add_assets()->set_id(it->first);
        page.mutable_assets()->rbegin()->set_msg_data(it->second);
      }
      return page.SerializeAsString();
    };
  }
  int asked = 0;

 private:
  std::map<std::string, std::string> records_;
};

const crypto::IdentityName pilot{"Org2MSP", "CN=pilot"}, guard{"Org1MSP", "CN=guard"};

TEST(RolesTest, OnlyTheOrganisationsThatMatterAreReadEachInOneQuestion) {
  RoleLedger ledger;
  ledger.add_table("Org1MSP", '3', {{"CN=guard", SUPERVISOR}});
  ledger.add_table("Org2MSP", '0', {{"CN=pilot", OPERATOR}});
  ledger.add_table("Org3MSP", '0', {{"CN=other", OPERATOR}});
  const auto roles = read_roles(ledger.evaluate(), {"Org1MSP", "Org2MSP"});
  ASSERT_TRUE(roles);
  EXPECT_EQ(roles->of(pilot), OPERATOR);
  EXPECT_EQ(roles->of(guard), SUPERVISOR);
  EXPECT_EQ(roles->of({"Org3MSP", "CN=other"}), ROLE_NONE);
  EXPECT_EQ(ledger.asked, 2);
  EXPECT_THAT(roles->followed(), UnorderedElementsAre("Org1MSP", "Org2MSP"));
}

TEST(RolesTest, AnOverfullOrganisationIsLeftOutAndNobodyElseFails) {
  RoleLedger ledger;
  ledger.add_table("Org1MSP", '3', {{"CN=guard", SUPERVISOR}});
  std::vector<std::pair<std::string, Role>> many;
  for (std::size_t i = 0; i <= contract::max_table_entries; ++i)
    many.emplace_back("CN=s" + std::to_string(i), OPERATOR);
  ledger.add_table("Org2MSP", '0', many);
  ledger.add("role/Org3MSP/0", "\xff\xff damaged");
  for (int i = 0; i < 10'050; ++i) ledger.add("role/Org4MSP/forged" + std::to_string(i), "");
  const auto roles = read_roles(ledger.evaluate(), {"Org1MSP", "Org2MSP", "Org3MSP", "Org4MSP"});
  ASSERT_TRUE(roles) << roles.error().message;
  EXPECT_EQ(roles->of(guard), SUPERVISOR);
  EXPECT_EQ(roles->all().size(), 1U);
  EXPECT_THAT(roles->left_out(), UnorderedElementsAre("Org2MSP", "Org3MSP", "Org4MSP"));
  EXPECT_LT(ledger.asked, 10) << "nor does one make them read for long";
}

TEST(RolesTest, TenThousandRolesOfTheVersionBeforeHideNobodyElses) {
  RoleLedger ledger;
  for (int i = 0; i < 10'050; ++i) ledger.add_before("Org3MSP", "CN=s" + std::to_string(i), AUDITOR);
  ledger.add_table("Org1MSP", '3', {{"CN=guard", SUPERVISOR}});
  ledger.add_table("Org2MSP", '3', {{"CN=pilot", OPERATOR}});
  const auto roles = read_roles(ledger.evaluate(), {"Org1MSP", "Org2MSP"});
  ASSERT_TRUE(roles);
  EXPECT_EQ(roles->all().size(), 2U);
  EXPECT_THAT(roles->left_out(), IsEmpty());
  const auto third = read_roles(ledger.evaluate(), {"Org1MSP", "Org3MSP"});
  ASSERT_TRUE(third);
  EXPECT_EQ(third->of(guard), SUPERVISOR);
  EXPECT_THAT(third->left_out(), ElementsAre("Org3MSP"));
}

TEST(RolesTest, RecordsOfTheVersionBeforeAreReadWhereThereAreNoTables) {
  RoleLedger ledger;
  ledger.add_before("Org2MSP", "CN=pilot", OPERATOR);
  ledger.add_before("Org1MSP", "CN=guard", SUPERVISOR);  // and tables: that one has been moved
  ledger.add_table("Org1MSP", '0', {});
  const auto roles = read_roles(ledger.evaluate(), {"Org1MSP", "Org2MSP"});
  ASSERT_TRUE(roles);
  EXPECT_EQ(roles->of(pilot), OPERATOR);
  EXPECT_EQ(roles->of(guard), ROLE_NONE);
}

TEST(RolesTest, ALedgerThatDoesNotAnswerIsAnError) {
  const auto silent = [](const fabric::Call&) -> Result<std::string> { return Error{"not reached"}; };
  EXPECT_THAT(read_roles(silent, {"Org1MSP"}).error().message, HasSubstr("not reached"));
}

TEST(RolesTest, EventsOfOneOrganisationFillItsOwnBoundAlone) {
  RolesByOrganisation roles;
  for (std::size_t i = 0; i < contract::max_organisation_roles + 50; ++i)
    roles.apply({to_message({"Org3MSP", "CN=s" + std::to_string(i)}), OPERATOR});
  roles.apply({to_message(pilot), OPERATOR});
  EXPECT_EQ(roles.of(pilot), OPERATOR);
  EXPECT_EQ(roles.all().size(), contract::max_organisation_roles + 1);
  EXPECT_THAT(roles.left_out(), ElementsAre("Org3MSP"));
  roles.apply({to_message({"Org3MSP", "CN=s0"}), REVOKED});
  EXPECT_EQ(roles.of({"Org3MSP", "CN=s0"}), REVOKED) << "who is known changes";
}

TEST(RolesTest, WhatIsReadLaterDoesNotUndoAnEventSince) {
  RolesByOrganisation roles;
  roles.await("Org2MSP");
  EXPECT_TRUE(roles.follows("Org2MSP"));
  EXPECT_THAT(roles.followed(), IsEmpty()) << "it may not be compared yet";
  roles.apply({to_message(pilot), REVOKED});
  RolesByOrganisation read;
  read.apply({to_message(pilot), OPERATOR});
  read.apply({to_message({"Org2MSP", "CN=rival"}), OPERATOR});
  roles.add(read);
  EXPECT_EQ(roles.of(pilot), REVOKED);
  EXPECT_EQ(roles.of({"Org2MSP", "CN=rival"}), OPERATOR);
  EXPECT_THAT(roles.followed(), ElementsAre("Org2MSP"));
}

TEST(RolesTest, TheOrganisationsOfADroneAreItsOwnAndThoseItIsGrantedTo) {
  Control control;
  control.mutable_owner()->set_msp_id("Org1MSP");
  control.add_grants()->mutable_to()->set_msp_id("Org2MSP");
  control.add_grants()->mutable_to()->set_msp_id("Org2MSP");
  EXPECT_THAT(organisations_of({control}), UnorderedElementsAre("Org1MSP", "Org2MSP"));
}

}  // namespace
}  // namespace ledgerline::verification
