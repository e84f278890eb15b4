#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "tools/configuration/config_file.hpp"
#include "tools/deployment/deployment.hpp"

/// What one host's configs must say, out of a deployment.toml or a connection profile of Fabric; and these configs by
/// its role. Pure.
/// What `ledgerline init` puts on a host: new files, and the host's identity, made on it: MSP_DIR/keystore/priv_sk,
/// which never leaves it, and MSP_DIR/signcerts/.
namespace ledgerline::init {

/// Where a host has the files that its configs name.
struct Directories {
  std::string config = "/etc/ledgerline";    ///< the configs, msp/, authorities/, tls/, CHANNEL.block
  std::string state{};                       ///< what programs remember; empty: the folder of each one's service
  std::string msp_dir{};                     ///< of the identity; empty: `config`/msp
  std::string tls_ca{};                      ///< for all servers of the ledger; empty: `config`/tls/MSPID.pem
  std::string config_block{};                ///< empty: `config`/CHANNEL.block
  std::string tls_certificate{}, tls_key{};  ///< that programs show to servers of the ledger; empty: none

  /// `service`: as its unit's StateDirectory has it.
  std::string state_of(const std::string& service) const { return state.empty() ? "/var/lib/" + service : state; }
  std::string msp() const { return msp_dir.empty() ? config + "/msp" : msp_dir; }
  std::string authority_of(const std::string& msp_id) const { return config + "/authorities/" + msp_id + ".pem"; }
  std::string tls_of(const std::string& whose) const {
    return tls_ca.empty() ? config + "/tls/" + whose + ".pem" : tls_ca;
  }
};

using configuration::Server;

/// A drone; `number` counts all drones of the deployment, so that it is the same at its host and at ground.
struct HostDrone {
  std::string name, address;
  int number = 1;
  std::string channel{};  ///< of HostPlan::more_channels; empty: HostPlan::channel
};

struct HostPlan {
  std::string host{};                             ///< its name
  std::string msp_id{};                           ///< of its identity
  std::string listen{};                           ///< of the ledger's part that it runs, HOST:PORT; empty: none
  std::vector<std::string> client_authorities{};  ///< files: whose TLS certificates that asks for; empty: none
  deployment::LedgerKind ledger = deployment::LedgerKind::embedded;
  std::string channel = "teleop", contract = "ledgerline";
  std::vector<std::string> more_channels{};  ///< that drones are on, too
  Server own{};                              ///< whom its programs ask
  std::map<std::string, Server> own_on{};    ///< the same by channel, where that is said; no endpoint: nobody serves it
  std::vector<Server> peers{};               ///< of each organisation, for receipts and the direct path
  std::vector<Server> orderers{};            ///< for the direct path; empty: it is not used
  std::vector<std::string> msp_ids{};        ///< of all organisations
  std::vector<HostDrone> drones{};           ///< that this host flies
  std::vector<HostDrone> all_drones{};       ///< that ground commands
  std::vector<deployment::Endpoint> network_peers{}, network_orderers{};  ///< by address, for net.toml
  deployment::Timeouts timeouts{};
  Directories folders;

  const Server& own_of(const std::string& of_channel) const;
};

/// An error names what is missing: the host, its organisation, a port.
Result<HostPlan> plan_of(const deployment::Deployment& deployment, const std::string& host, const Directories& folders);

/// Of `--drone`: "tello1=192.168.10.1", or "tello1" where it is not flown from here.
Result<std::vector<HostDrone>> drones_of(const std::vector<std::string>& texts);

/// Further channels, each as "NAME=DRONE,DRONE": sets which drone is on which; a bare NAME is the first one's. An error
/// names what does not fit.
Status add_channels(HostPlan& plan, const std::vector<std::string>& texts);

/// A file that a profile has in its text.
struct PublicFile {
  std::string path, content;
};
struct ProfilePlan {
  HostPlan plan;
  std::vector<PublicFile> files;  ///< TLS authorities, for Directories::tls_of; and authorities, for authority_of
  std::optional<fabric::Batching> batching{};  ///< as the channel's config block has it
};
/// Of Fabric's connection profile (JSON): the peers of `msp_id`'s organisation, the first of which is asked, those of
/// others, and orderers. For a channel of its `channels` it is the first one that it lists there. Authorities that it
/// has as PEM (in base64, too) become files, those that it has as paths are named: `profile_folder`, absolute, is what
/// a relative one counts from. A channel `_default` is every one without an entry of its own. `channels`: as
/// add_channels() takes them; where the profile names several that none of them gives drones to, a bare NAME says which
/// one is the first, else an error does. `block`: of the first channel, where its config block is at hand: its name,
/// organisations and batching count, and the organisations' authorities become files.
Result<ProfilePlan> plan_of_profile(std::string_view json, const std::string& msp_id, const std::string& host,
                                    const Directories& folders, std::vector<std::string> channels = {},
                                    const std::string& profile_folder = "",
                                    const fabric::ChannelConfig* block = nullptr);

/// admin: the identity that enrols drones and gives grants, from any host.
enum class Role : std::uint8_t { drone_host, ground, ledger, chaincode, bridge, admin };
inline constexpr std::array roles{"drone-host", "ground", "ledger", "chaincode", "bridge", "admin"};
static_assert(roles.size() == enum_count<Role>);
Role role_of(std::string_view name);  ///< a name of the array

struct File {
  std::string name;  ///< within the config folder
  std::string text;
};

/// An error: the role has nothing to do on that host, such as flying none of the drones.
Result<std::vector<File>> files_of(Role role, const HostPlan& plan);

/// A deployment.toml to begin with: three hosts, two drones, and every key in the reference's words.
Result<std::string> example_deployment();

struct NewFile {
  std::string path, content;
  int mode = 0644;
};

/// An error names all that are there.
Status check_new(const std::vector<std::string>& paths);

/// All of them, or none: a file that is there is an error, unless it has this content already.
Status write_new(const std::vector<NewFile>& files);

/// Makes the key (0600, on the disk when this returns) where there is none, and writes the request to `request_file`.
/// An error: either is there already.
Status request_identity(const std::string& msp_dir, const std::string& request_file, const crypto::Subject& subject);

/// Puts a certificate beside the key, after a check that it is of this key, not expired and of an authority that the
/// host knows (check_authority); one that is there is replaced, as when it is renewed. Of a chain the one that is of
/// this key is put first. Returns whose it is.
Result<std::string> install_certificate(const Directories& folders, const std::string& certificate_file);

/// Whether the certificate of `msp_dir` is of the organisation that a config in `config_dir` says of this folder, or
/// else of any, by config_dir/authorities/MSPID.pem. done, too, where there is no such file: nobody knows.
Status check_authority(const std::string& config_dir, const std::string& msp_dir, const std::string& certificate_pem);

/// Copies what other hosts may know out of the folder of an embedded ledger or a network (DIR/crypto,
/// DIR/CHANNEL.block) into `out`: authorities/MSPID.pem, tls/MSPID.pem, tls/orderers.pem, CHANNEL.block. No key.
/// Nothing is overwritten: files that are there must be the same.
Status collect_public(const std::string& ledger_dir, const std::string& out);

}  // namespace ledgerline::init
