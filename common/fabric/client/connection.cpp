#include "common/fabric/client/connection.hpp"

#include <fmt/format.h>
#include <google/protobuf/any.pb.h>
#include <google/protobuf/empty.pb.h>
#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/crypto/identities/renewal.hpp"
#include "common/fabric/tls/grpc_locks.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/block_validator.hpp"
#include "gateway/gateway.pb.h"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::fabric {
namespace {

// Peers refuse to be pinged more often than once a minute (Fabric's peer.keepalive.minInterval).
constexpr int keepalive_ms = 60'000;
// gRPC makes this TCP's user timeout as well: a connection that takes nothing any more is given up after it.
constexpr int keepalive_timeout_ms = 5'000;
constexpr int first_reconnect_ms = 50, max_reconnect_ms = 1'000, connect_timeout_ms = 2'000;
constexpr TimeNs renew_again_ns = 1 * ns_per_s;
// As Fabric's own clients: a block may hold an envelope of many megabytes.
constexpr int max_message_bytes = 100 * 1024 * 1024;
constexpr int window_bytes = 1024 * 1024;  // of a stream: a chain that is caught up with over a long way

// Names are looked up as all of this host's programs do it (nsswitch.conf: mDNS, LDAP, /etc/hosts), and not by gRPC's
// own resolver, which asks DNS alone. gRPC reads this once, before any channel is made; a user's own choice counts.
[[maybe_unused]] const bool system_names = ::setenv("GRPC_DNS_RESOLVER", "native", 0) == 0;

/// As it was renewed, else as its files have it.
Result<TlsPairsInUse::Pair> read_pair(const ClientConfig::TlsPair& files, const TlsPairsInUse* in_use) {
  if (in_use) {
    if (auto renewed = in_use->of(files.certificate_file)) return std::move(*renewed);
  }
  auto pair = crypto::read_pair({files.certificate_file, files.key_file});
  if (!pair) return pair.error();
  if (Status fits = crypto::check_fits(pair->key_pem, pair->certificate_pem); !fits)
    return Error{fmt::format("{} and {}: {}", files.certificate_file, files.key_file, fits.error().message)};
  return TlsPairsInUse::Pair{std::move(pair->certificate_pem), std::move(pair->key_pem)};
}

Result<std::string> tls_hash_of(const ClientConfig::TlsPair& files, const TlsPairsInUse* in_use) {
  if (files.certificate_file.empty()) return std::string();
  const auto pair = read_pair(files, in_use);
  if (!pair) return pair.error();
  const auto hash = crypto::certificate_hash(pair->certificate_pem);
  if (!hash) return hash.error();
  return std::string(reinterpret_cast<const char*>(hash->data()), hash->size());
}

/// As it counts, since one without a pair of its own has the client's.
ClientConfig::Server with_pair(ClientConfig::Server server, const ClientConfig& config) {
  if (server.tls_pair.certificate_file.empty() && server.tls_pair.key_file.empty()) server.tls_pair = config.tls_pair;
  return server;
}

Result<std::shared_ptr<grpc::Channel>> make_channel(const ClientConfig::Server& server, const TlsPairsInUse* in_use) {
  if (Status s = check_endpoint(server.endpoint); !s) return Error{"the ledger's endpoint " + s.error().message};
  auto authorities = crypto::read_certificate_file(server.tls_ca_file);
  if (!authorities) return Error{fmt::format("tls_ca of {}: {}", server.endpoint, authorities.error().message)};
  grpc::SslCredentialsOptions tls;
  tls.pem_root_certs = std::move(*authorities);
  const ClientConfig::TlsPair& own = server.tls_pair;
  if (own.certificate_file.empty() != own.key_file.empty())
    return Error{"tls_certificate and tls_key belong together: one of them is missing"};
  if (!own.certificate_file.empty()) {
    auto pair = read_pair(own, in_use);
    if (!pair) return pair.error();
    tls.pem_cert_chain = std::move(pair->certificate_pem);
    tls.pem_private_key = std::move(pair->key_pem);
  }
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, keepalive_ms);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, keepalive_timeout_ms);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, first_reconnect_ms);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, connect_timeout_ms);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, max_reconnect_ms);
  // Its pings, which size the window, would answer each message and wake both ends.
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  arguments.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, window_bytes);
  arguments.SetMaxReceiveMessageSize(max_message_bytes);
  arguments.SetMaxSendMessageSize(max_message_bytes);
  // A ledger is reached by nobody's web proxy, whatever https_proxy says.
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  // Each client has a connection of its own, also when one process has several.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  if (!server.server_name.empty()) arguments.SetSslTargetNameOverride(server.server_name);
  return grpc::CreateCustomChannel(server.endpoint, grpc::SslCredentials(tls), arguments);
}

Result<std::shared_ptr<const GrpcChannels>> make_channels(const ClientConfig& config) {
  using Servers = std::vector<ClientConfig::Server>;
  take_locks_at_once();
  auto channels = std::make_shared<GrpcChannels>();
  const TlsPairsInUse* const in_use = config.tls_in_use.get();
  const auto connect = [&](const Servers& servers, std::vector<std::shared_ptr<grpc::Channel>>& into) -> Status {
    for (const ClientConfig::Server& server : servers) {
      auto channel = make_channel(with_pair(server, config), in_use);
      if (!channel) return channel.error();
      into.push_back(std::move(*channel));
    }
    return done;
  };
  const auto hash = [&](const Servers& servers, std::vector<std::string>& into) -> Status {
    for (const ClientConfig::Server& server : servers) {
      auto of_pair = tls_hash_of(with_pair(server, config).tls_pair, in_use);
      if (!of_pair) return of_pair.error();
      into.push_back(std::move(*of_pair));
    }
    return done;
  };
  Servers peers{{config.endpoint, config.tls_ca_file, config.server_name, config.tls_pair}};
  peers.insert(peers.end(), config.other_peers.begin(), config.other_peers.end());
  if (auto s = connect(peers, channels->peers); !s) return s.error();
  if (auto s = connect(peers, channels->stream_peers); !s) return s.error();
  if (auto s = connect(config.orderers, channels->orderers); !s) return s.error();
  if (config.blocks != BlockSource::peer) {
    if (auto s = connect(config.orderers, channels->stream_orderers); !s) return s.error();
  }
  for (const ClientConfig::Endorser& endorser : config.endorsers) {
    if (endorser.endpoint == config.endpoint) {
      channels->endorsers.push_back(channels->peers[0]);
    } else if (auto s = connect({{endorser.endpoint, endorser.tls_ca_file, endorser.server_name, endorser.tls_pair}},
                                channels->endorsers);
               !s) {
      return s.error();
    }
  }
  if (auto s = hash(peers, channels->peer_tls_hashes); !s) return s.error();
  if (auto s = hash(config.orderers, channels->orderer_tls_hashes); !s) return s.error();
  return std::shared_ptr<const GrpcChannels>(std::move(channels));
}

}  // namespace

Result<std::shared_ptr<const Connection>> make_connection(ClientConfig config) {
  // protobuf would write a line to standard error for each malformed text that a hostile transaction carries.
  google::protobuf::SetLogHandler(nullptr);
  if (!config.identity.signer) return Error{"the ledger's client has no identity to sign with"};
  if (config.blocks != BlockSource::peer && config.orderers.empty())
    return Error{"ledger.blocks: without [[orderer]] there are the peer's blocks alone"};
  if (config.own_endorser && config.orderers.empty())
    return Error{"own_endorser: what it endorses goes to an orderer, and no [[orderer]] is named"};
  if (config.blocks == BlockSource::ordered && config.config_block.empty())
    return Error{"ledger.blocks: an orderer's blocks cannot be validated without ledger.config_block"};
  if (!config.config_block.empty()) {
    const auto validator = BlockValidator::from(config.config_block, config.where.channel, config.verifier);
    if (!validator) return Error{"ledger.config_block: " + validator.error().message};
  }
  if (!config.identity.in_use) config.identity.in_use = std::make_shared<crypto::IdentityInUse>(config.identity);
  auto channels = make_channels(config);
  if (!channels) return channels.error();
  return std::make_shared<const Connection>(std::move(config), std::move(*channels));
}

Connection::Connection(ClientConfig settings, std::shared_ptr<const GrpcChannels> channels)
    : config(std::move(settings)),
      channels_(std::move(channels)),
      renewals_(config.tls_in_use ? config.tls_in_use->renewals() : 0) {}

std::shared_ptr<const GrpcChannels> Connection::channels() const {
  const std::lock_guard lock(mutex_);
  const std::uint64_t renewals = config.tls_in_use ? config.tls_in_use->renewals() : 0;
  if (renewals == renewals_ || monotonic_ns() < renew_from_ns_) return channels_;
  if (auto next = make_channels(config)) {
    channels_ = std::move(*next);
    renewals_ = renewals;
    problem_.clear();
  } else {
    // Such as an authority's file that is just being written.
    renew_from_ns_ = monotonic_ns() + renew_again_ns;
    if (std::exchange(problem_, next.error().message) != next.error().message)
      spdlog::error("the ledger's connections keep their old TLS certificates, tried again each second: {}", problem_);
  }
  return channels_;
}

std::size_t Connection::peer() const {
  const auto now = channels();
  const auto& peers = now->peers;
  if (peers.size() == 1 || peers[0]->GetState(true) != GRPC_CHANNEL_TRANSIENT_FAILURE) return 0;
  for (std::size_t i = 1; i < peers.size(); ++i) {
    if (peers[i]->GetState(true) == GRPC_CHANNEL_READY) return i;
  }
  return 0;
}

const std::string& Connection::endpoint(std::size_t peer) const {
  return peer == 0 ? config.endpoint : config.other_peers[peer - 1].endpoint;
}

std::vector<std::size_t> Connection::endorsers_now(const std::function<bool(std::size_t)>& rests) const {
  const auto now = channels();
  const auto& endorsers = now->endorsers;
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < endorsers.size(); ++i) {
    const auto known = std::find_if(chosen.begin(), chosen.end(), [&](std::size_t one) {
      return config.endorsers[one].msp_id == config.endorsers[i].msp_id;
    });
    if (known == chosen.end()) {
      chosen.push_back(i);
    } else if (((rests && rests(*known)) || endorsers[*known]->GetState(true) == GRPC_CHANNEL_TRANSIENT_FAILURE) &&
               endorsers[i]->GetState(true) == GRPC_CHANNEL_READY) {
      *known = i;
    }
  }
  return chosen;
}

bool may_pass(const grpc::Status& status) {
  return status.error_code() == grpc::StatusCode::UNAVAILABLE ||
         status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED;
}

bool is_away(const grpc::Status& status) {
  return may_pass(status) || status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED ||
         status.error_code() == grpc::StatusCode::CANCELLED;
}

std::optional<Attempts::Time> Attempts::next(const grpc::Status& status, Time deadline, Random& random) {
  const Time at = std::chrono::system_clock::now() + std::chrono::nanoseconds(back_off_.next(random));
  return may_pass(status) && ++made_ < max_made && at < deadline ? std::optional(at) : std::nullopt;
}

namespace {
// By gRPC's own words: an endorser that answers for its contract alone says UNAVAILABLE, too.
bool is_unreached(const grpc::Status& status) { return status.error_message().starts_with("failed to connect"); }
}  // namespace

std::string describe(const grpc::Status& status) {
  // google.rpc.Status, whose field 3 is the list of details; no package has its C++ without more of googleapis.
  google::protobuf::Empty wrapper;
  std::string text;
  const std::string own = words_of_peer(status.error_message());
  if (is_unreached(status))
    return fmt::format("not reached: is it up, and are endpoint, tls_ca and server_name its own? ({})", own);
  if (own == "Deadline Exceeded") return "no answer in time";  // gRPC's own words: the server said nothing
  if (own.empty() && status.error_code() == grpc::StatusCode::UNIMPLEMENTED)
    return "this endpoint does not offer that: it is no gateway (of `ledgerline node` the first endpoint is)";
  if (!wrapper.ParseFromString(status.error_details())) return own;
  const auto& fields = wrapper.GetReflection()->GetUnknownFields(wrapper);
  for (int i = 0; i < fields.field_count(); ++i) {
    google::protobuf::Any any;
    gateway::ErrorDetail detail;
    if (fields.field(i).number() != 3 ||
        fields.field(i).type() != google::protobuf::UnknownField::TYPE_LENGTH_DELIMITED ||
        !any.ParseFromString(fields.field(i).length_delimited()) || !any.type_url().ends_with("/gateway.ErrorDetail") ||
        !detail.ParseFromString(any.value()) || detail.message().empty() ||
        text.find(detail.message()) != std::string::npos) {
      continue;
    }
    text += (text.empty() ? "" : "; ") + detail.message();
  }
  return text.empty() ? own : words_of_peer(text);
}

Result<protos::ProposalResponse> query_peer(const std::string& endpoint, const std::shared_ptr<grpc::Channel>& peer,
                                            std::string_view signed_proposal, std::chrono::milliseconds deadline) {
  protos::SignedProposal question;
  if (!parse(question, signed_proposal)) return Error{"what was to be asked is no proposal"};
  protos::ProposalResponse response;
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + deadline);
  const grpc::Status status = protos::Endorser::NewStub(peer)->ProcessProposal(&context, question, &response);
  if (is_unreached(status)) return Error{endpoint + " is " + describe(status)};
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED)
    return Error{fmt::format("{} did not answer within {:g} s", endpoint, static_cast<double>(deadline.count()) / 1e3)};
  if (!status.ok()) return Error{describe(status)};
  return response;
}

std::uint64_t random_seed() {
  const std::string bytes = crypto::random_bytes(sizeof(std::uint64_t));
  std::uint64_t seed = 0;
  std::memcpy(&seed, bytes.data(), sizeof seed);
  return seed;
}

void Commits::on_update(std::function<void()> wake) {
  const std::lock_guard lock(mutex_);
  wake_ = std::move(wake);
}

bool Commits::await(const std::string& tx_id) {
  const std::lock_guard lock(mutex_);
  if (streams_ == 0) return false;
  awaited_.insert(tx_id);
  return true;
}

void Commits::forget(const std::string& tx_id) {
  const std::lock_guard lock(mutex_);
  awaited_.erase(tx_id);
}

Commits::Update Commits::pop_update() {
  const std::lock_guard lock(mutex_);
  return std::exchange(update_, {});
}

void Commits::connected(bool is) {
  const std::lock_guard lock(mutex_);
  streams_ += is ? 1 : -1;
  if (streams_ > 0 || awaited_.empty()) return;
  update_.lost = true;
  if (wake_) wake_();
}

void Commits::block(const Block& block) {
  const std::lock_guard lock(mutex_);
  bool some = false;
  for (const Transaction& tx : block.transactions) {
    if (awaited_.erase(tx.tx_id) == 0) continue;
    update_.seen.push_back({tx.tx_id, block.number, tx.code});
    some = true;
  }
  if (some && wake_) wake_();
}

}  // namespace ledgerline::fabric
