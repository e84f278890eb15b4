#include "common/fabric/tls/certificate_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "common/base/log.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {
namespace {

using crypto::Renewal;

std::int64_t unix_now_s() { return realtime_ns() / ns_per_s; }

/// Each pair of files once.
std::vector<ClientConfig::TlsPair> pairs_of(const ClientConfig& ledger,
                                            const std::vector<ClientConfig::TlsPair>& further) {
  std::vector<ClientConfig::TlsPair> all{ledger.tls_pair};
  all.insert(all.end(), further.begin(), further.end());
  for (const auto* servers : {&ledger.orderers, &ledger.other_peers}) {
    for (const ClientConfig::Server& server : *servers) all.push_back(server.tls_pair);
  }
  for (const ClientConfig::Endorser& endorser : ledger.endorsers) all.push_back(endorser.tls_pair);
  std::vector<ClientConfig::TlsPair> out;
  for (const ClientConfig::TlsPair& one : all) {
    const bool known =
        std::ranges::any_of(out, [&](const auto& other) { return other.certificate_file == one.certificate_file; });
    if (!one.certificate_file.empty() && !known) out.push_back(one);
  }
  return out;
}

std::int64_t end_of(const crypto::SigningIdentity& identity) {
  const auto read = crypto::read_serialized(identity.serialized);
  return read ? read->certificate.not_after_s : std::numeric_limits<std::int64_t>::max();
}

}  // namespace

Result<std::unique_ptr<CertificateWatch>> CertificateWatch::create(ClientConfig& ledger,
                                                                   std::unique_ptr<crypto::MspRegistry> trusted,
                                                                   const std::vector<ClientConfig::TlsPair>& further) {
  ledger.identity.in_use = std::make_shared<crypto::IdentityInUse>(ledger.identity);
  if (trusted && !trusted->member(ledger.identity.serialized, std::nullopt)) trusted.reset();
  std::unique_ptr<CertificateWatch> watch(new CertificateWatch(ledger, std::move(trusted)));
  for (ClientConfig::TlsPair& files : pairs_of(ledger, further)) {
    auto pair = crypto::read_pair({files.certificate_file, files.key_file});
    if (!pair) return pair.error();
    const std::string whose = fmt::format("TLS, {}", files.certificate_file);
    watch->pairs_.push_back({.files = std::move(files),
                             .renewal = {whose, "", pair->certificate.not_after_s, std::move(pair->certificate_pem)}});
  }
  watch->update_first_end();
  ledger.tls_in_use = watch->in_use_;
  return watch;
}

Result<std::unique_ptr<CertificateWatch>> watch_certificates(Config& config, ClientConfig& ledger,
                                                             const std::vector<ClientConfig::TlsPair>& further) {
  auto trusted = msp_registry(config);
  if (!trusted) return trusted.error();
  return CertificateWatch::create(ledger, std::move(*trusted), further);
}

void CertificateWatch::log(Weight weight, const std::string& words) {
  spdlog::log(weight == Weight::info      ? spdlog::level::info
              : weight == Weight::warning ? spdlog::level::warn
                                          : spdlog::level::err,
              "{}", words);
}

CertificateWatch::CertificateWatch(const ClientConfig& ledger, std::unique_ptr<crypto::MspRegistry> trusted)
    : source_(ledger.identity_source),
      identity_(ledger.identity.in_use),
      trusted_(std::move(trusted)),
      in_use_(std::make_shared<TlsPairsInUse>()),
      identity_renewal_(fmt::format("{} {}", ledger.identity.name.msp_id, ledger.identity.name.subject),
                        ledger.identity.name.subject, end_of(ledger.identity), ledger.identity.serialized) {}

CertificateWatch::~CertificateWatch() = default;

void CertificateWatch::start(Report report, std::chrono::milliseconds period) {
  report_ = std::move(report);
  thread_ = std::jthread([this, period](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      poll();
      std::unique_lock lock(mutex_);
      woken_.wait_for(lock, stop, period, [] { return false; });
    }
  });
}

std::int64_t CertificateWatch::days_left() const { return crypto::days_left(first_end_s_, unix_now_s()); }

void CertificateWatch::update_first_end() {
  std::int64_t first_s = identity_renewal_.not_after_s();
  for (const Pair& pair : pairs_) first_s = std::min(first_s, pair.renewal.not_after_s());
  first_end_s_ = first_s;
}

void CertificateWatch::poll() {
  const std::int64_t now_s = unix_now_s();
  poll_identity(now_s);
  for (Pair& pair : pairs_) poll_pair(pair, now_s);
}

/// Proved to be a pair by who loaded it, and of a trusted authority.
Result<Renewal::Pair> CertificateWatch::checked(const Result<crypto::SigningIdentity>& found,
                                                std::int64_t now_s) const {
  if (!found) return found.error();
  if (trusted_) {
    if (const auto member = trusted_->member(found->serialized, now_s); !member)
      return Error{fmt::format("it is no member of {}: {}", found->name.msp_id, member.error().message)};
  }
  auto read = crypto::read_serialized(found->serialized);
  if (!read) return read.error();
  return Renewal::Pair{std::move(read->certificate), {}, found->serialized};
}

/// What is to be used from now on in place of the one that is in use.
std::optional<Renewal::Pair> CertificateWatch::renewed(Renewal& renewal, const std::vector<std::string>& files,
                                                       std::int64_t now_s, const Renewal::Load& load) {
  auto found = renewal.check_files(files, now_s, load);
  if (!found) return std::nullopt;
  if (!*found) {
    report_(Weight::alarm, fmt::format("{} keeps its old certificate, what lies on disk is refused: {}",
                                       renewal.whose(), found->error().message));
    return std::nullopt;
  }
  if (!(*found)->is_new) return std::nullopt;
  update_first_end();
  report_(Weight::info, fmt::format("{} has a renewed certificate, for {}; it is used from now on", renewal.whose(),
                                    crypto::span_in_words(renewal.not_after_s() - now_s)));
  return std::move(**found);
}

void CertificateWatch::poll_identity(std::int64_t now_s) {
  const auto files = source_.files_now();
  const std::vector<std::string> names =
      files ? std::vector{files->certificate, files->private_key} : std::vector<std::string>();
  std::optional<crypto::SigningIdentity> next;
  const auto load = [&]() -> Result<Renewal::Pair> {
    auto found = files ? crypto::load_identity(source_.library, source_.msp_id, *files)
                       : Result<crypto::SigningIdentity>(files.error());
    auto pair = checked(found, now_s);
    if (found) next = std::move(*found);
    return pair;
  };
  if (renewed(identity_renewal_, names, now_s, load)) identity_->replace(std::move(*next));
  report_end(identity_renewal_, now_s);
}

void CertificateWatch::poll_pair(Pair& pair, std::int64_t now_s) {
  const crypto::IdentityFiles files{pair.files.certificate_file, pair.files.key_file};
  if (auto next = renewed(pair.renewal, {files.certificate, files.private_key}, now_s,
                          [&] { return crypto::read_pair(files); }))
    in_use_->renew(files.certificate, {std::move(next->certificate_pem), std::move(next->key_pem)});
  report_end(pair.renewal, now_s);
}

void CertificateWatch::report_end(Renewal& renewal, std::int64_t now_s) {
  if (const auto word = renewal.pop_end_notice(now_s))
    report_(word->weight == Renewal::Weight::alarm ? Weight::alarm : Weight::warning, word->words);
}

}  // namespace ledgerline::fabric
