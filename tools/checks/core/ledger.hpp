#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/policy.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "tools/checks/core/problem.hpp"

/// What is checked of a way to a peer or an orderer, each layer by itself; of a channel, its contract and the drones'
/// records. Pure.
namespace ledgerline::checks {

/// What agent.toml and ground.toml say of time.
struct TimeoutInputs {
  std::string program;
  std::optional<TimeNs> max_age_ns{}, silent_after_ns{};  ///< of agent alone
  TimeNs deadline_ns = 0;
  bool of_channel = false;  ///< [ledger] timeouts = "auto": they grow by themselves
};
Finding assess(const fabric::Batching& batching, const TimeoutInputs& inputs);

/// What the peer answered in place of the contract's result: whether it does not reach the contract's service, and why,
/// by Fabric's words or since only this call has no answer in time.
Finding assess_refusal(const std::string& words);

/// The definition that is committed.
struct ContractInputs {
  std::string name;
  std::string refused{};  ///< the peer's words where there is none
  std::string version{}, own_version{};
  bool weak = false;  ///< one organisation alone satisfies its policy
};
Findings assess(const ContractInputs& inputs);

/// Who asks: a program of that host, or a flight that is to take off.
enum class Side : std::uint8_t { agent, ground, flight };
struct LeaseInputs {
  std::string drone;
  crypto::IdentityName self{};  ///< who asks
  Side side = Side::flight;
  std::optional<Control> control{};  ///< none: it is not enrolled
  bool is_operator = false;          ///< of ground: `self`, by the ledger's roles
  bool enrols = false;               ///< of a flight: drones that are not enrolled yet
};
/// A flight cannot take off with what is otherwise a warning: somebody else's lease, a stop.
Findings assess(const LeaseInputs& inputs);
/// Whether another one holds it and lets `self` command it.
bool is_delegated(const LeaseInputs& inputs);

/// Of the newest block, and of one a moment later.
struct HeightInputs {
  std::string place;
  std::uint64_t height = 0, later = 0;
  std::optional<std::uint64_t> elsewhere{};  ///< of another organisation's peer
  std::optional<TimeNs> newest_age_ns{};     ///< by this host's clock, since its newest transaction was signed
};
Findings assess(const HeightInputs& inputs);

/// Between `real_ns` and when the newest transaction of a serialized common.Block was signed, as its signer claims;
/// none: it cannot be read, or no transaction claims a time of our age.
std::optional<TimeNs> age_of_block(const std::string& block, TimeNs real_ns);

/// A peer that was asked to sign a call.
struct EndorsingPeer {
  std::string msp_id;              ///< who it is, by its signature; where it has not signed: who it is said to be
  std::string place;               ///< "[[endorser]] 10.0.0.2:7061", "the gateway"
  std::string why{};               ///< it has not signed; empty: it has
  std::string said_to_be{msp_id};  ///< by the config
  std::string identity{place};     ///< of two with the same one counts
};

struct EndorsementInputs {
  std::string program;  ///< "ground.toml"
  std::string what;     ///< that must be endorsed: "new records of contract ledgerline"
  fabric::Policy policy;
  std::vector<std::string> organisations;  ///< of the channel
  std::vector<EndorsingPeer> peers{};
  bool by_gateway = false;  ///< it finds the peers; else the config names them
};
/// Whether the peers that sign for a program are those whose signatures its calls need.
Finding assess(const EndorsementInputs& inputs);

struct ServerInputs {
  std::string what;            ///< "peer of agent.toml"
  std::string endpoint;        ///< HOST:PORT
  std::string name;            ///< that its certificate must have
  std::string tls_ca;          ///< file
  std::string no_authority{};  ///< why tls_ca was not read
  Problem authority_problem = Problem::tls_ca_unreadable;
  std::string authority_cure{};
  std::string no_pair{};  ///< the files of the own certificate, where they are none
  enum class Reached : std::uint8_t { yes, malformed, name_unknown, no_route, silent, closed };
  Reached reached = Reached::yes;
  std::string why{};  ///< it was not reached, in the system's words
  bool tls = false;   ///< the handshake succeeded, with any server
  bool http2 = false;
  bool mute = false;                  ///< it took the connection and then said nothing in time
  bool wants_certificate = false;     ///< and has not got one
  std::string refuses_certificate{};  ///< the alert that it answered the own certificate with; empty: none
  // Of its certificate.
  bool trusted = false, right_name = false, expired = false, not_yet = false;
  std::string issuer{}, names{};
};
Finding assess(const ServerInputs& inputs);
/// Whether it answers; whom it takes and who it is, its clients check.
Finding assess_presence(ServerInputs inputs);

/// A channel's orderers, of programs that leave them to their peer: it must reach them, this host need not. So one that
/// does not serve is a warning. It is broken only if none of them serves and its own host is reached, but its port is
/// closed or says nothing.
Findings assess_orderers(const std::vector<ServerInputs>& orderers);

/// Whether it is HOST:PORT; "[::1]:7051" is.
bool is_endpoint(const std::string& text);

}  // namespace ledgerline::checks
