#pragma once
#include <netinet/in.h>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/scheduling.hpp"

namespace ledgerline::network {

/// Where one part of a network listens: three TCP ports from `port` on.
struct ListenAddress {
  std::string host;
  std::uint16_t port = 0;
  std::string text(int port_offset = 0) const;  ///< "HOST:PORT"
  sockaddr_in address() const;
  bool operator==(const ListenAddress&) const = default;
};

/// A network of three organisations with one peer each, and one or three Raft orderers; all on one host by default.
struct Options {
  std::string dir;    ///< everything of it: identities, ledgers, logs
  std::string tools;  ///< folder with Fabric's programs and sample configuration (scripts/fabric-tools)
  std::string chaincode = "ledgerline-chaincode";     ///< the chaincode service's program
  std::string host = "127.0.0.1";                     ///< of every part, where no addresses are given
  std::uint16_t first_port = 0;                       ///< 0: free ones are looked for
  int orderers = 1;                                   ///< 1 or 3
  std::vector<ListenAddress> organisation_addresses;  ///< empty, or of all organisations
  std::vector<ListenAddress> orderer_addresses;       ///< empty, or of all orderers
  std::vector<std::string> only;                      ///< parts that this host runs ("org1", "orderer2"); empty: all
  std::vector<std::string> background;                ///< organisations ("org3") for whom nobody on this host waits
  bool short_slices = false;                          ///< of all other parts here
  TimeNs timeout_ns = 120 * ns_per_s;                 ///< how long parts on other hosts are waited for
  std::vector<std::string> channels{"teleop"};
  std::vector<std::string> drones{};  ///< that are enrolled first; none: tello1 to tello16
  int batch_count = 1;
  TimeNs batch_timeout_ns = 10 * ns_per_ms;
  /// Also how much of Raft's log an orderer reads at a time when it starts: more than lies between two snapshots,
  /// because 2.5.0 may hang when it comes in parts (issue 4199 of hyperledger/fabric; OrdererWatch).
  std::uint64_t batch_bytes = 10'000'000;
  bool ca = false;  ///< identities from fabric-ca, one an organisation; on one host alone
  /// Of this host's peers: without it the contract's `history` fails there, and a block's event leaves earlier.
  bool history = true;
  /// Of the contract's definition, in Fabric's words; empty: the channel's, a majority.
  std::string signature_policy{};

  bool runs_organisation(int number) const { return runs("org" + std::to_string(number)); }
  bool runs_orderer(int number) const { return runs("orderer" + std::to_string(number)); }
  /// Of its peer and its chaincode service.
  Scheduling organisation_scheduling(int number) const;
  Scheduling orderer_scheduling() const { return short_slices ? Scheduling::short_slices : Scheduling::inherited; }
  bool several_hosts() const { return !only.empty(); }

 private:
  bool runs(const std::string& part) const;
};

/// Adds what a network's TOML file says.
Result<Options> read_options(const std::string& file, Options options);
Result<Options> read_options(Config& config, Options options);

/// What is wrong with them together, such as two orderers.
Status check(const Options& options);

/// "10.0.0.1:7051".
Result<ListenAddress> parse_listen_address(const std::string& text);
Status parse_listen_addresses(const std::vector<std::string>& texts, std::vector<ListenAddress>& addresses);

/// Of all parts, as "HOST:PORT".
struct ListenAddresses {
  static constexpr int ports_each = 3;

  std::vector<ListenAddress> orderers, organisations;
  std::vector<ListenAddress> authorities;  ///< of fabric-ca, one port each, the orderers' first; empty: there are none
  std::string orderer(int number) const { return at(orderers, number).text(); }
  std::string orderer_admin(int number) const;
  std::string orderer_operations(int number) const;
  std::string peer(int organisation) const { return at(organisations, organisation).text(); }
  std::string peer_chaincode(int organisation) const { return at(organisations, organisation).text(1); }
  /// 0: the orderers'.
  std::string authority(int organisation) const { return at(authorities, organisation + 1).text(); }
  std::string chaincode(int organisation) const { return at(organisations, organisation).text(2); }
  /// Those that this host needs, as they are bound; without the authorities', which listen before the others.
  std::vector<ListenAddress> bound(const Options& options) const;
  bool operator==(const ListenAddresses&) const = default;

 private:
  static const ListenAddress& at(const std::vector<ListenAddress>& addresses, int number) {
    return addresses[static_cast<std::size_t>(number - 1)];
  }
};

/// All on one host, one after the other.
ListenAddresses listen_addresses_from(const Options& options, std::uint16_t first_port);

// Where the parts of a network listen. That is in the channels' first blocks and in packages, so a directory keeps it.

/// Those that the directory keeps; the first time those of the options, or free ports of this host, which are then
/// kept. An error: the directory is of a network with others.
Result<ListenAddresses> choose_listen_addresses(const Options& options);

/// An error names the first one that cannot be listened on, and why.
Status check_free(const std::vector<ListenAddress>& addresses);

// Each host's own part of a network that was prepared in one address.

/// The parts that listen at one address.
struct HostParts {
  std::string host;
  std::vector<int> organisations, orderers;
};
/// By address, in the order of their first mention; empty: the options have no addresses.
std::vector<HostParts> hosts_of(const Options& options);

/// Copies into `to` what a host needs of the directory `from` that Network::prepare() filled: the private keys of its
/// own organisations' peers, chaincode services and users, and of its own orderers; of all others certificates alone;
/// addresses and the channels' first blocks. The keys of authorities and of the orderers' administrator stay in `from`.
/// `to` is made under another name and renamed when complete; one that is there already is left as it is.
Status write_host(const std::string& from, const HostParts& parts, const Options& options, const std::string& to);

// What Fabric's programs read: pure functions of the options.

/// configtx.yaml with the profile `Ledgerline`.
std::string configtx_yaml(const Options& options, const ListenAddresses& addresses);

/// "NAME=value" for an orderer, a peer, and the `peer` command line in the name of an organisation's administrator.
std::vector<std::string> orderer_environment(const Options& options, const ListenAddresses& addresses, int number);
std::vector<std::string> peer_environment(const Options& options, const ListenAddresses& addresses, int organisation);
std::vector<std::string> admin_environment(const Options& options, const ListenAddresses& addresses, int organisation);
/// Of an organisation's chaincode service, whose package has this id.
std::vector<std::string> chaincode_environment(const Options& options, const ListenAddresses& addresses,
                                               int organisation, const std::string& package_id);

/// connection.json of an organisation's chaincode package: mutual TLS, without the peer's pair, which builder_script's
/// release adds. An administrator of the organisation can fetch a package, and archives get copied around.
std::string connection_json(const ListenAddresses& addresses, int organisation, const std::string& ca_pem);

/// The peers' external builder for chaincode as a service: the programs detect, build and release. They read the peer's
/// TLS pair where its environment says.
std::string builder_script(const std::string& name);

}  // namespace ledgerline::network
