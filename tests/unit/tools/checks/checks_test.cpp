#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <nlohmann/json.hpp>

#include "common/common.pb.h"
#include "tools/checks/core/drone.hpp"
#include "tools/checks/core/host.hpp"
#include "tools/checks/core/identity.hpp"
#include "tools/checks/core/ledger.hpp"
#include "tools/checks/shell/host_probe.hpp"

namespace ledgerline::checks {
namespace {

using testing::HasSubstr;

TEST(DoctorBlocks, ThatComeLateNameTheTimesThatFit) {
  TimeoutInputs usual{
      .program = "agent.toml", .max_age_ns = 500 * ns_per_ms, .silent_after_ns = ns_per_s, .deadline_ns = ns_per_s};
  const fabric::Batching slow{.timeout_ns = 2 * ns_per_s, .max_messages = 10};
  const Finding late = assess(slow, usual);
  EXPECT_EQ(late.problem, Problem::blocks_late);
  EXPECT_THAT(
      late.cure,
      HasSubstr("[check] max_age_ms = 4500, [agent] ledger_silent_after_ms = 5000, [ledger] deadline_ms = 5000"));
  usual.of_channel = true;
  EXPECT_FALSE(assess(slow, usual).problem) << "they grow by themselves";
  usual = {.program = "agent.toml",
           .max_age_ns = 4500 * ns_per_ms,
           .silent_after_ns = 5 * ns_per_s,
           .deadline_ns = 5 * ns_per_s};
  EXPECT_FALSE(assess(slow, usual).problem);
  EXPECT_FALSE(
      assess(fabric::Batching{.timeout_ns = 2 * ns_per_s, .max_messages = 1}, {.program = "a", .deadline_ns = ns_per_s})
          .problem)
      << "cut at once";
}

TEST(Doctor, ReportsAProblemOnce) {
  const Finding wrong = flag(Problem::config_wrong, "config", "agent.toml:3: x: unknown key");
  const Findings all{wrong, fine("clock", "good"), wrong, of_drone("a", wrong)};
  EXPECT_EQ(words(without_repeats(all)), words({wrong, fine("clock", "good"), of_drone("a", wrong)}));
}

TEST(DoctorContract, AServiceThatIsDownIsNotAPeerThatRefuses) {
  for (const char* words :
       {"error in simulation: failed to execute transaction 1f: could not launch chaincode ledgerline_1:2a: connection "
        "to "
        "ledgerline_1:2a failed: error creating grpc connection to cc:9999: context deadline exceeded",
        "control/tello1: 10.0.0.2:7051 did not answer within 3 s"})
    EXPECT_EQ(assess_refusal(words).problem, Problem::contract_silent) << words;
  EXPECT_EQ(assess_refusal("access denied: channel [teleop]").problem, Problem::ledger_refuses);
}

TEST(DoctorContract, EachReasonWhyAServiceIsSilentHasItsCure) {
  const std::string launch = "could not launch chaincode ledgerline_1:2a: connection to ledgerline_1:2a failed: ";
  EXPECT_EQ(assess_refusal(launch + "dial tcp 10.0.0.3:9999: connect: connection refused").cure, "") << "its own";
  EXPECT_THAT(assess_refusal(launch + "failed to create new connection: context deadline exceeded").cure,
              HasSubstr("--tls-root"));
  EXPECT_THAT(assess_refusal("10.0.0.2:7051 did not answer within 3 s").cure, HasSubstr("CHAINCODE_ID"));
  EXPECT_THAT(assess_refusal("chaincode definition for 'ledgerline' exists, but chaincode is not installed").cure,
              HasSubstr("contract install"));
}

Finding server(const std::function<void(ServerInputs&)>& change) {
  ServerInputs inputs{.what = "peer", .endpoint = "h:1", .name = "h", .tls_ca = "ca.pem"};
  inputs.tls = inputs.http2 = inputs.trusted = inputs.right_name = true;
  change(inputs);
  return assess(inputs);
}

TEST(DoctorServer, TellsEachLayerApart) {
  using Reached = ServerInputs::Reached;
  EXPECT_FALSE(server([](auto&) {}).problem);
  EXPECT_EQ(server([](auto& f) { f.reached = Reached::name_unknown; }).problem, Problem::name_unknown);
  EXPECT_EQ(server([](auto& f) { f.reached = Reached::no_route; }).problem, Problem::no_route);
  EXPECT_EQ(server([](auto& f) { f.reached = Reached::silent; }).problem, Problem::unreachable);
  EXPECT_EQ(server([](auto& f) { f.reached = Reached::closed; }).problem, Problem::port_closed);
  EXPECT_EQ(server([](auto& f) { f.tls = false; }).problem, Problem::no_tls);
  EXPECT_EQ(server([](auto& f) { f.http2 = false; }).problem, Problem::no_tls);
  EXPECT_EQ(server([](auto& f) { f.right_name = false; }).problem, Problem::tls_wrong_name);
  EXPECT_EQ(server([](auto& f) { f.expired = true; }).problem, Problem::tls_expired);
  EXPECT_EQ(server([](auto& f) { f.not_yet = true; }).problem, Problem::tls_not_yet);
  EXPECT_EQ(server([](auto& f) { f.wants_certificate = true; }).problem, Problem::tls_client_certificate);
  EXPECT_EQ(server([](auto& f) { f.trusted = false, f.expired = true; }).problem, Problem::tls_wrong_authority)
      << "dates of an outsider's certificate mean nothing";
}

TEST(DoctorServer, NamesTheOrdererThatIsDownBehindAGateway) {
  const auto at = [](const std::string& endpoint, ServerInputs::Reached reached) {
    ServerInputs inputs{.what = "channel c's orderers", .endpoint = endpoint, .name = "o", .tls_ca = ""};
    inputs.reached = reached;
    inputs.wants_certificate = true;
    return inputs;
  };
  using Reached = ServerInputs::Reached;
  const Findings one_of_two = assess_orderers({at("a:7050", Reached::yes), at("b:7050", Reached::closed)});
  EXPECT_FALSE(one_of_two.at(0).problem) << "it asks others than its clients for a certificate";
  EXPECT_EQ(one_of_two.at(1).problem, Problem::port_closed);
  EXPECT_EQ(one_of_two[1].severity, Severity::warning) << "the other one orders";
  EXPECT_THAT(one_of_two[1].what, HasSubstr("b:7050"));
  EXPECT_EQ(assess_orderers({at("b:7050", Reached::closed)}).at(0).severity, Severity::broken);
  EXPECT_EQ(assess_orderers({at("b:7050", Reached::silent)}).at(0).severity, Severity::warning)
      << "a firewall may let the peers alone through";
}

TEST(DoctorServer, SaysWhatToWriteForAnEndpointThatIsNone) {
  const auto cure = [](const std::string& endpoint) {
    ServerInputs inputs{.what = "peer", .endpoint = endpoint, .name = "", .tls_ca = ""};
    inputs.reached = ServerInputs::Reached::malformed;
    const Finding finding = assess(inputs);
    EXPECT_EQ(finding.problem, Problem::endpoint_wrong);
    return finding.cure;
  };
  EXPECT_THAT(cure("https://tower:7051/"), HasSubstr("\"tower:7051\""));
  EXPECT_THAT(cure("tower"), HasSubstr("\"tower:PORT\""));
  EXPECT_TRUE(is_endpoint("[fd00::2]:7051"));
  EXPECT_FALSE(is_endpoint("tower:"));
}

TEST(DoctorServer, TellsOneThatIsMuteFromOneThatSpeaksSomethingElse) {
  EXPECT_EQ(server([](auto& f) { f.tls = false, f.mute = true; }).problem, Problem::server_mute);
}

TEST(DoctorIdentity, TellsAFolderOfAnotherUserAndALockedKeyFromAMissingOne) {
  IdentityInputs inputs{.msp_id = "Org1MSP", .place = "/e/msp", .no_key = "cannot read it"};
  inputs.forbidden = "/e/msp";
  inputs.user = "ledgerline";
  const Findings closed = assess(inputs, {}, 0);
  EXPECT_EQ(closed.at(0).problem, Problem::file_forbidden);
  EXPECT_THAT(closed[0].cure, HasSubstr("`chown -R ledgerline: /e/msp`"));
  inputs = {.msp_id = "Org1MSP", .place = "/e/msp", .certificate_pem = std::string("\x30\x82\x01", 3)};
  EXPECT_EQ(assess(inputs, {}, 0).at(0).problem, Problem::not_pem);
}

// What programs and peers take for the identity is the first certificate of the file.
TEST(DoctorIdentity, TellsAnAuthorityInFrontOfTheCertificateFromAKeyOfAnother) {
  const auto ca = crypto::make_ca("ca", "org").value();
  const auto own =
      crypto::issue(ca, {.common_name = "raven", .organization = "o", .unit = "client", .sans = {}}).value();
  const std::int64_t now_s = crypto::parse_certificate(own.certificate_pem)->not_before_s + 60;
  IdentityInputs inputs{
      .msp_id = "Org1MSP", .place = "/e/msp", .certificate_pem = ca.certificate_pem + own.certificate_pem};
  inputs.key_pem = own.key_pem;
  inputs.certificate_file = "/e/msp/signcerts/cert.pem";
  inputs.msp_dir = "/e/msp";
  const std::vector<AuthorityInputs> authorities{{"Org1MSP", ca.certificate_pem}};
  const Findings reversed = assess(inputs, authorities, now_s);
  ASSERT_EQ(reversed.size(), 1U) << "the certificate itself is in order: dates and issuer are checked of it";
  EXPECT_EQ(reversed[0].problem, Problem::certificate_order);
  EXPECT_EQ(reversed[0].cure, "`ledgerline init --certificate /e/msp/signcerts/cert.pem --msp-dir /e/msp`");
  inputs.msp_dir.clear();
  inputs.key_file = "/e/own.key";
  EXPECT_THAT(assess(inputs, authorities, now_s).at(0).cure,
              HasSubstr("the certificate of the key /e/own.key to the front"));
  inputs.certificate_pem = own.certificate_pem + ca.certificate_pem;
  EXPECT_FALSE(assess(inputs, authorities, now_s).at(0).problem);
  inputs.certificate_pem = ca.certificate_pem + ca.certificate_pem;
  EXPECT_EQ(assess(inputs, authorities, now_s).at(0).problem, Problem::key_misfit);
}

TEST(DoctorIdentity, NamesTheChannelWhoseAuthoritiesDoNotKnowIt) {
  const auto ca = crypto::make_ca("ca", "org").value(), other = crypto::make_ca("ca", "org").value();
  const auto own =
      crypto::issue(ca, {.common_name = "raven", .organization = "o", .unit = "client", .sans = {}}).value();
  IdentityInputs inputs{.msp_id = "Org1MSP", .place = "/e/msp", .certificate_pem = own.certificate_pem};
  inputs.channel = "yard";
  const Finding foreign = assess(inputs, {{"Org1MSP", other.certificate_pem}},
                                 crypto::parse_certificate(own.certificate_pem)->not_before_s + 60)
                              .at(0);
  EXPECT_EQ(foreign.problem, Problem::identity_foreign);
  EXPECT_THAT(foreign.what, HasSubstr("on channel yard"));
}

TEST(DoctorIdentity, SaysHowLongInTheUnitThatFits) {
  const auto ca = crypto::make_ca("ca", "org").value();
  const auto own =
      crypto::issue(ca, {.common_name = "raven", .organization = "o", .unit = "client", .sans = {}}).value();
  const std::int64_t end_s = crypto::parse_certificate(own.certificate_pem)->not_after_s;
  const auto what = [&](std::int64_t now_s) {
    return assess({.msp_id = "Org1MSP", .place = "/e/msp", .certificate_pem = own.certificate_pem}, {}, now_s)
        .at(0)
        .what;
  };
  EXPECT_THAT(what(end_s + 5), HasSubstr(", 5 seconds ago"));
  EXPECT_THAT(what(end_s + 86'400), HasSubstr(", 24 hours ago"));
  EXPECT_THAT(what(end_s + 3 * 86'400), HasSubstr(", 3 days ago"));
  EXPECT_THAT(what(end_s - 150), HasSubstr(", in 2 minutes"));
  EXPECT_THAT(what(end_s - 10 * 86'400), HasSubstr(", in 10 days"));
}

TEST(DoctorServer, TellsWhoHasNoCertificateFromWhoseIsNotTaken) {
  EXPECT_EQ(server([](auto& f) { f.tls = false, f.refuses_certificate = "tlsv1 alert unknown ca"; }).problem,
            Problem::tls_pair_refused);
  EXPECT_EQ(server([](auto& f) { f.refuses_certificate = "tlsv1 alert unknown ca"; }).problem,
            Problem::tls_pair_refused);
  EXPECT_EQ(server([](auto& f) { f.tls = false, f.no_pair = "a and b"; }).problem, Problem::tls_pair_wrong);
}

TEST(DoctorIdentity, ChecksAPairOfTlsByItsOwnWords) {
  const auto ca = crypto::make_ca("ca", "org").value();
  const auto own =
      crypto::issue(ca, {.common_name = "raven", .organization = "o", .unit = "client", .sans = {}}).value();
  const auto certificate = crypto::parse_certificate(own.certificate_pem).value();
  IdentityInputs inputs{.msp_id = "TLS", .place = "/e/own.pem", .certificate_pem = own.certificate_pem};
  inputs.certificate_file = "/e/own.pem";
  inputs.key_file = "/e/own.key";
  inputs.key_pem = own.key_pem;
  EXPECT_FALSE(assess_tls_pair(inputs, "agent.toml", certificate.not_before_s + 60).at(0).problem);
  const Finding over = assess_tls_pair(inputs, "agent.toml", certificate.not_after_s + 86'400).at(0);
  EXPECT_EQ(over.problem, Problem::tls_pair_wrong);
  EXPECT_THAT(over.what, HasSubstr("/e/own.pem and /e/own.key of agent.toml: identity_expired"));
  const auto other = crypto::issue(ca, {.common_name = "x", .organization = "o", .unit = "client", .sans = {}}).value();
  inputs.key_pem = other.key_pem;
  EXPECT_EQ(assess_tls_pair(inputs, "agent.toml", certificate.not_before_s + 60).at(0).problem,
            Problem::tls_pair_wrong);
  inputs.key_pem = own.key_pem;
  inputs.key_is_open = true;
  EXPECT_EQ(assess_tls_pair(inputs, "agent.toml", certificate.not_before_s + 60).at(0).cure, "`chmod 600 /e/own.key`");
}

TEST(DoctorHost, TellsADroneWhoseStatesAreDroppedFromOneThatIsSilent) {
  DroneInputs inputs{.name = "tello1", .address = "192.168.10.1", .there = true, .battery = 0.9};
  EXPECT_FALSE(assess_state(inputs, "0.0.0.0:8891")) << "nobody could listen";
  EXPECT_FALSE(assess_presence(inputs).problem);
  inputs.state_hz = 0;
  const Finding dropped = assess_state(inputs, "0.0.0.0:8891").value();
  EXPECT_EQ(dropped.problem, Problem::state_silent);
  EXPECT_THAT(dropped.cure, HasSubstr("`iptables -I INPUT -p udp --dport 8891 -j ACCEPT`"));
  inputs.unreadable = "bat: 87;";
  const Finding unreadable = assess_state(inputs, "0.0.0.0:8891").value();
  EXPECT_EQ(unreadable.problem, Problem::state_unreadable) << "no firewall is to blame";
  EXPECT_THAT(unreadable.what, HasSubstr("\"bat: 87;\""));
  EXPECT_THAT(assess_battery(inputs, 0.15).what, HasSubstr("90 %"));
  inputs.there = false;
  EXPECT_EQ(assess_presence(inputs).problem, Problem::drone_silent);
}

TEST(DoctorLease, IsAWarningUnlessAFlightIsToTakeOff) {
  Control control;
  control.mutable_owner()->set_msp_id("Org2MSP");
  control.mutable_holder()->set_msp_id("Org3MSP");
  LeaseInputs inputs{.drone = "d1", .self = {"Org2MSP", "CN=pilot"}, .side = Side::ground, .control = control};
  inputs.is_operator = true;
  EXPECT_EQ(assess(inputs).at(0).severity, Severity::warning);
  inputs.side = Side::flight;
  EXPECT_EQ(assess(inputs).at(0).problem, Problem::lease_held);
  EXPECT_EQ(assess(inputs).at(0).severity, Severity::broken);
  inputs.side = Side::agent;
  EXPECT_EQ(assess(inputs).at(0).problem, Problem::of_another_host);
  inputs.control.reset();
  EXPECT_EQ(assess(inputs).at(0).problem, Problem::not_enrolled);
}

class DoctorEndorsement : public testing::Test {
 protected:
  static fabric::Policy so_many_of(std::size_t needed) {
    return {{fabric::peer_policy("Org1MSP"), fabric::peer_policy("Org2MSP"), fabric::peer_policy("Org3MSP")}, needed};
  }
  static EndorsingPeer signs(const std::string& msp_id) {
    return {.msp_id = msp_id, .place = "[[endorser]] " + msp_id};
  }
  static EndorsingPeer silent(const std::string& msp_id) {
    return {.msp_id = msp_id, .place = "[[endorser]] h:7051", .why = "nobody listens"};
  }
  EndorsementInputs inputs_{.program = "ground.toml",
                            .what = "new records",
                            .policy = so_many_of(2),
                            .organisations = {"Org1MSP", "Org2MSP", "Org3MSP"},
                            .peers = {signs("Org1MSP")}};
};

TEST_F(DoctorEndorsement, NamesEachOrganisationOfWhichOneWouldDo) {
  const Finding finding = assess(inputs_);
  EXPECT_EQ(finding.problem, Problem::policy_unreachable);
  EXPECT_THAT(finding.what, HasSubstr("the signature of Org2MSP or Org3MSP is missing"));
  EXPECT_EQ(finding.cure,
            "add an [[endorser]] of Org2MSP to ground.toml; or add an [[endorser]] of Org3MSP to ground.toml");
  inputs_.peers.push_back(signs("Org3MSP"));
  EXPECT_FALSE(assess(inputs_).problem);
}

TEST_F(DoctorEndorsement, NamesAllThatAreMissingAtOnce) {
  inputs_.policy = so_many_of(3);
  inputs_.peers.push_back(silent("Org2MSP"));
  const Finding finding = assess(inputs_);
  EXPECT_THAT(finding.what, HasSubstr("the signature of Org2MSP and Org3MSP is missing"));
  EXPECT_THAT(finding.what, HasSubstr("[[endorser]] h:7051 of Org2MSP: nobody listens"));
  EXPECT_THAT(finding.cure, HasSubstr("start the peer of Org2MSP, [[endorser]] h:7051"));
  EXPECT_THAT(finding.cure, HasSubstr("; and add an [[endorser]] of Org3MSP"));
}

TEST_F(DoctorEndorsement, CountsAPeerOnceAndAsWhoItIs) {
  EndorsingPeer copied = signs("Org1MSP");
  copied.said_to_be = "Org2MSP";
  inputs_.peers = {signs("Org1MSP"), copied};
  const Finding finding = assess(inputs_);
  EXPECT_EQ(finding.problem, Problem::policy_unreachable);
  EXPECT_THAT(finding.what, HasSubstr("of Org2MSP is a peer of Org1MSP"));
  EXPECT_THAT(finding.cure, HasSubstr("set endpoint and tls_ca of the [[endorser]] of Org2MSP in ground.toml"));
  inputs_.policy = {{fabric::peer_policy("Org1MSP"), fabric::peer_policy("Org1MSP")}, 2};
  EXPECT_FALSE(assess(inputs_).problem) << "two parts of one policy are satisfied by one peer each by itself";
}

TEST_F(DoctorEndorsement, SaysOfAPolicyThatNobodyCanSatisfyThatTheDefinitionMustChange) {
  inputs_.policy = {{fabric::peer_policy("Org1MSP"), fabric::peer_policy("Org9MSP")}, 2};
  const Finding finding = assess(inputs_);
  EXPECT_EQ(finding.problem, Problem::policy_unreachable);
  EXPECT_THAT(finding.what, HasSubstr("a peer of each organisation of the channel would not do"));
  EXPECT_THAT(finding.cure, HasSubstr("commit a definition"));
}

TEST_F(DoctorEndorsement, OfAGatewaySaysWhatItMustFind) {
  inputs_.by_gateway = true;
  inputs_.peers = {
      {.msp_id = "Org1MSP", .place = "the gateway", .identity = "Org1MSP"}, silent("Org2MSP"), silent("Org3MSP")};
  const Finding finding = assess(inputs_);
  EXPECT_EQ(finding.problem, Problem::policy_unreachable);
  EXPECT_THAT(finding.cure, HasSubstr("start a peer of Org2MSP that has joined the channel"));
}

TEST(DoctorHost, SaysOfSharedMemoryWhatKeepsRoudiFromStartingAndWhoElseMayWriteIt) {
  using Roudi = SharedMemoryInputs::Roudi;
  SharedMemoryInputs inputs{.roudi = Roudi::alive, .program = "ledgerline-roudi"};
  ASSERT_EQ(assess(inputs).size(), 1U);
  EXPECT_FALSE(assess(inputs)[0].problem);
  inputs.left_behind = {"ledgerline-link", "ledgerline-agent"};
  EXPECT_EQ(assess(inputs).at(0).problem, Problem::roudi_replaced);
  EXPECT_THAT(assess(inputs)[0].what, HasSubstr("ledgerline-link, ledgerline-agent"));
  inputs.left_behind.clear();
  inputs.not_writable = "mode 755";
  inputs.group_unusable = "domain users";
  EXPECT_EQ(assess(inputs).size(), 1U) << "it runs, so another user's group counts";
  inputs.roudi = Roudi::none;
  const Findings place = assess_place(inputs);
  ASSERT_EQ(place.size(), 2U);
  EXPECT_EQ(place[0].problem, Problem::roudi_group);
  EXPECT_EQ(place[1].problem, Problem::shm_not_writable);
  EXPECT_EQ(assess(inputs).size(), 3U) << "and nobody answers";
  SharedMemoryInputs shared{.roudi = Roudi::alive, .group_shared = "group users has other users (u2)"};
  EXPECT_EQ(assess(shared).at(0).problem, Problem::roudi_group_shared);
  EXPECT_EQ(assess(shared).at(0).severity, Severity::warning);
  shared.by_unit = true;
  EXPECT_FALSE(assess(shared).at(0).problem) << "not the group of who asks";
}

// The unit's capabilities are not those of the user who runs doctor.
TEST(DoctorHost, SaysOfRealTimeWhatTheRunningLinkHas) {
  const RealTimeInputs of_user{.fifo = false, .locked = false};
  EXPECT_EQ(assess(of_user).at(0).problem, Problem::no_real_time);
  EXPECT_THAT(assess(of_user)[0].what, HasSubstr("of this user"));
  EXPECT_FALSE(assess(RealTimeInputs{.fifo = true, .locked = true, .link = 7}).at(0).problem);
  const Findings slow = assess(RealTimeInputs{.fifo = false, .locked = true, .link = 7, .unit = "link.service"});
  ASSERT_EQ(slow.size(), 1U);
  EXPECT_EQ(slow[0].problem, Problem::no_real_time) << "what it has counts, not what its unit would give";
  EXPECT_THAT(slow[0].what, HasSubstr("of link, process 7"));
  const RealTimeInputs own = probe_real_time(true, ::getpid());
  EXPECT_EQ(own.link, ::getpid());
  EXPECT_FALSE(own.fifo);
  EXPECT_FALSE(probe_real_time(true, 0x7fffffff).locked) << "it has ended meanwhile";
}

TEST(DoctorHost, NamesWhoHasThePortOfStateTexts) {
  const Finding taken = assess(PortInputs{.listen = "0.0.0.0:8890", .taken = true, .program = "python3", .pid = 7});
  EXPECT_EQ(taken.problem, Problem::state_port_taken);
  EXPECT_THAT(taken.cure, HasSubstr("`kill 7`"));
  EXPECT_FALSE(assess(PortInputs{.listen = "0.0.0.0:8890"}).problem);
}

TEST(DoctorHost, WarnsOfAServiceThatDoesNotRun) {
  const Finding idle = assess_not_running("agent", "/etc/ledgerline/agent.toml");
  EXPECT_EQ(idle.severity, Severity::warning) << "nobody may have started it yet";
  EXPECT_THAT(idle.what, HasSubstr("/etc/ledgerline/agent.toml"));
  EXPECT_THAT(idle.cure, HasSubstr("`systemctl start ledgerline-agent`"));
}

TEST(DoctorHost, ComparesTheDronesOfLinkAndAgentInAnyOrder) {
  EXPECT_FALSE(assess_names({"b", "a"}, {"a", "b"}).problem);
  EXPECT_EQ(assess_names({"a"}, {"a", "b"}).problem, Problem::drones_differ);
}

TEST(DoctorChain, TellsClocksByTheNewestBlock) {
  const auto problem = [](HeightInputs inputs) { return assess(inputs)[0].problem; };
  EXPECT_EQ(problem({.place = "p", .height = 5, .later = 5, .newest_age_ns = -ns_per_s}), Problem::clock_behind);
  EXPECT_EQ(problem({.place = "p", .height = 5, .later = 9, .newest_age_ns = 60 * ns_per_s}), Problem::clock_ahead);
  EXPECT_EQ(problem({.place = "p", .height = 5, .later = 5, .newest_age_ns = 60 * ns_per_s}), std::nullopt)
      << "a quiet ledger";
  EXPECT_EQ(problem({.place = "p", .height = 5, .later = 5, .elsewhere = 50}), Problem::peer_lags);
}

std::string block_signed_at(std::initializer_list<std::int64_t> claimed_s) {
  common::Block block;
  for (const std::int64_t at_s : claimed_s) {
    common::ChannelHeader channel;
    channel.mutable_timestamp()->set_seconds(at_s);
    common::Payload payload;
    payload.mutable_header()->set_channel_header(channel.SerializeAsString());
    common::Envelope envelope;
    envelope.set_payload(payload.SerializeAsString());
    block.mutable_data()->add_data(envelope.SerializeAsString());
  }
  return block.SerializeAsString();
}

TEST(DoctorChain, TakesNoTimeThatNobodyCanMeanForABlocks) {
  const TimeNs now_ns = 1'800'000'000 * ns_per_s;
  EXPECT_EQ(age_of_block(block_signed_at({1'799'999'990, 1'799'999'998}), now_ns), 2 * ns_per_s);
  EXPECT_EQ(age_of_block(block_signed_at({1'799'999'998, INT64_MAX, INT64_MIN, 300'000'000'000}), now_ns), 2 * ns_per_s)
      << "the signer of a transaction may claim anything";
  EXPECT_FALSE(age_of_block(block_signed_at({INT64_MAX}), now_ns));
  EXPECT_FALSE(age_of_block("\xff", now_ns));
}

TEST(DoctorTrust, ComparesAuthoritiesByTheirCertificates) {
  const auto pem = [](const std::string& key) {
    return "-----BEGIN CERTIFICATE-----\n" + key + "\n-----END CERTIFICATE-----\n";
  };
  const auto problem_of = [&](const std::string& own) {
    TrustInputs inputs{.program = "agent.toml", .msps = {{"Org2MSP", "org2.pem"}}, .channel = {}};
    inputs.msps[0].pem = own;
    inputs.channel.push_back({"Org2MSP", pem("cm9v\ndA==") + pem("bWlk")});
    return assess(inputs)[0].problem;
  };
  EXPECT_FALSE(problem_of("Subject: mid\n" + pem("bWlk") + pem("cm9vdA=="))) << "another order, other lines";
  EXPECT_FALSE(problem_of(pem("cm9vdA=="))) << "the root alone";
  EXPECT_EQ(problem_of(pem("bWlk") + pem("b3RoZXI=")), Problem::authority_foreign);
  EXPECT_EQ(problem_of("no certificate"), Problem::authority_foreign);
}

TEST(DoctorContract, TellsNoneAnotherVersionAndAWeakPolicyApart) {
  EXPECT_EQ(assess({.name = "c", .refused = "not there"})[0].problem, Problem::contract_missing);
  EXPECT_EQ(assess({.name = "c", .version = "1", .own_version = "2"})[0].problem, Problem::contract_other_version);
  EXPECT_EQ(assess({.name = "c", .version = "2", .own_version = "2", .weak = true})[0].problem, Problem::policy_weak);
}

TEST(DoctorHost, WarnsOfADiskBeforeItIsFull) {
  EXPECT_EQ(assess(DirectoryInputs{"/x", true, 1ULL << 20})[0].problem, Problem::disk_full);
  EXPECT_EQ(assess(DirectoryInputs{"/x", true, 500ULL << 20})[0].problem, Problem::disk_low);
  EXPECT_FALSE(assess(DirectoryInputs{"/x", true, 5ULL << 30})[0].problem);
}

TEST(DoctorHost, TellsAnEmptyTopicFromOneWithoutThisDrone) {
  const TopicInputs silent{.drone = "tello1", .topic = "/poses", .type = "a/msg/B", .listened_s = 2};
  TopicInputs others = silent, heard = silent, deaf = silent;
  others.writers = 1;
  heard.writers = 1;
  heard.poses = 120;
  deaf.why = "no such interface";
  EXPECT_EQ(assess(silent).problem, Problem::pose_silent);
  EXPECT_NE(assess(silent).what.find("nobody publishes"), std::string::npos);
  EXPECT_EQ(assess(others).problem, Problem::pose_silent);
  EXPECT_NE(assess(others).what.find("of this drone"), std::string::npos);
  EXPECT_NE(assess(deaf).what.find("no such interface"), std::string::npos);
  EXPECT_FALSE(assess(heard).problem);
  EXPECT_NE(assess(heard).what.find("60 a second"), std::string::npos);
}

TEST(DoctorList, IsBrokenByOneProblemAndNotByWarnings) {
  Findings all{fine("config", "a"), flag(Problem::disk_low, "disk", "b")};
  EXPECT_FALSE(anything_broken(all));
  all.push_back(flag(Problem::key_open, "identity", "c\x1b[2J"));
  EXPECT_TRUE(anything_broken(all));
  const auto said = nlohmann::json::parse(to_json(all));
  EXPECT_EQ(said["ok"], false);
  EXPECT_EQ(said["checks"][2]["problem"], "key_open");
  EXPECT_EQ(said["checks"][0]["cure"], nullptr);
  EXPECT_EQ(said["checks"][0]["drone"], nullptr);
  EXPECT_EQ(words(all).find('\x1b'), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::checks
