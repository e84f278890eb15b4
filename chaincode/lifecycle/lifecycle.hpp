#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/validation/channel_config.hpp"

/// Fabric's lifecycle of a chaincode (`_lifecycle`), as an organisation's administrator: no program of Fabric's is
/// needed.
namespace ledgerline::chaincode_lifecycle {

/// What a channel's organisations agree on.
struct Definition {
  std::string version;
  std::int64_t sequence = 0;
  bool operator==(const Definition&) const = default;
};

struct Installed {
  std::string package_id, label;
};

/// The definition that counts on the channel.
struct Committed {
  Definition definition;
  std::string policy;                     ///< protos.ApplicationPolicy, serialized
  std::map<std::string, bool> approvals;  ///< of it, by MSP id
};

/// Talks to the one peer of `config`, whose `where` says channel and chaincode; transactions go by its gateway, which
/// finds the endorsements. One thread. Errors are the peer's words.
class Lifecycle {
 public:
  static Result<Lifecycle> connect(fabric::ClientConfig config);

  const std::string& msp_id() const { return msp_id_; }
  Result<std::vector<Installed>> installed();
  Status install(const std::string& package);
  /// nullopt: the channel has none.
  Result<std::optional<Committed>> committed();
  /// The package that the own organisation has approved for this definition; nullopt: it has not, or for another one.
  Result<std::optional<std::string>> approved(const Definition& definition);
  /// Who has approved a definition that is not committed yet, by MSP id.
  Result<std::map<std::string, bool>> approvals(const Definition& definition);
  /// Without a policy of its own: the channel's, /Channel/Application/Endorsement.
  Status approve(const Definition& definition, const std::string& package_id);
  Status commit(const Definition& definition);
  /// Whether the peer reaches the contract's service; an error has the peer's words. Waits longer than a peer tries to
  /// connect, so that what it does not answer at all was not for want of a connection.
  Status contract_answers();
  Result<fabric::ChannelConfig> channel() { return questions_->channel_config(); }

 private:
  Lifecycle(fabric::ChannelAndContract where, std::string msp_id, std::unique_ptr<fabric::PeerQueries> questions,
            std::unique_ptr<fabric::PeerQueries> calls, std::unique_ptr<fabric::Client> client);
  Result<std::string> query(const std::string& channel, const std::string& function, const std::string& argument);
  /// Again until it is committed or refused, or `is_done`.
  Status submit(const std::string& function, const std::string& argument, const fabric::EndorsementNeed& need,
                const std::function<Result<bool>()>& is_done);

  fabric::ChannelAndContract where_;
  std::string msp_id_;
  std::unique_ptr<fabric::PeerQueries> questions_;
  std::unique_ptr<fabric::PeerQueries> calls_;  ///< of the contract
  std::unique_ptr<fabric::Client> client_;
};

/// What of a channel's rules bears on Ledgerline.
struct Fitness {
  std::string policy;  ///< the contract's endorsement policy, in words
  bool direct =
      false;  ///< two organisations' endorsements satisfy it: the direct path ([[orderer]], [[endorser]]) works
  std::string direct_why;  ///< in words
};
Fitness fitness_of(const fabric::ChannelConfig& channel, const std::string& application_policy);

/// The same steps as commands of Fabric's `peer`, for those who may run only that. Pure.
/// `client`: what its files and places are; `msp_dir`: as the peer's program wants it. What is not known stands in
/// capitals.
struct PeerCommands {
  const fabric::ClientConfig& client;
  std::string msp_dir;

  std::string environment() const;  ///< export lines, for all of them
  std::string install(const std::string& package_file) const;
  /// `package_id` empty: that of the file.
  std::string approve(const Definition& definition, const std::string& package_id,
                      const std::string& package_file) const;
  std::string commit(const Definition& definition) const;
  std::string status() const;

 private:
  std::string to_orderer() const;
  std::string of(const Definition& definition) const;
};

// A chaincode package that says where a chaincode service is (type ccaas). Pure.

/// How peers reach the service.
struct ServicePlace {
  std::string address;           ///< HOST:PORT, as peers see it
  std::string root_pem{};        ///< authorities of its TLS certificate; empty: no TLS
  bool client_auth = false;      ///< the service wants the peer's certificate (CHAINCODE_TLS_CLIENT_CA)
  std::string client_pem{};      ///< that certificate, where the peer's builder does not put its own in
  std::string client_key_pem{};  ///< its key: anyone who may fetch the package has it
};
std::string connection_json(const ServicePlace& place);

/// tar.gz of metadata.json and of code.tar.gz with connection.json. The same bytes for the same input, so the package's
/// id stays, wherever it is made.
std::string make_package(const std::string& label, const std::string& connection);
/// "label:hash", as peers name it, and as the service gets it in CHAINCODE_ID.
std::string package_id(const std::string& label, const std::string& package);
/// Fabric's rule: a-z, A-Z and 0-9, inside also _ . + -
bool is_label(const std::string& text);

}  // namespace ledgerline::chaincode_lifecycle
