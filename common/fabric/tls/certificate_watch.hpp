#pragma once
#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/crypto/identities/renewal.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric {

class CertificateWatch;
/// Of a program's config: checks new identities by its [[msp]], read again, since a registry is of one thread. `ledger`
/// as for CertificateWatch::create; `further`: TLS pairs of tables that it does not have, such as [[channel]].
Result<std::unique_ptr<CertificateWatch>> watch_certificates(Config& config, ClientConfig& ledger,
                                                             const std::vector<ClientConfig::TlsPair>& further = {});

/// Takes renewed certificates of a program's clients from their files while it runs: the identity of [ledger], and each
/// TLS pair of its tables. What it refuses stays as it was (crypto::Renewal). One thread of its own, which sleeps but
/// for a few calls of stat each `period`.
///
/// Calls that begin after a change are signed with the new certificate, and connections are recreated with the new TLS
/// pair. Calls and streams in flight end over the old ones.
class CertificateWatch {
 public:
  /// So long after the second file of a pair is in place two looks at most pass until it counts.
  static constexpr std::chrono::milliseconds usual_period{1000};

  enum class Weight { info, warning, alarm };
  /// On the watch's own thread.
  using Report = std::function<void(Weight weight, const std::string& words)>;

  /// Makes `ledger` one whose clients are renewed: before they are created. `trusted`: a registry of the watch's own,
  /// so that a certificate that is of no authority of the own MSP is refused; null, or one that does not know the
  /// identity that is there now: who signed a new one is the ledger's matter. An error: a TLS pair cannot be read.
  static Result<std::unique_ptr<CertificateWatch>> create(ClientConfig& ledger,
                                                          std::unique_ptr<crypto::MspRegistry> trusted,
                                                          const std::vector<ClientConfig::TlsPair>& further = {});
  ~CertificateWatch();

  /// For callers that have no other place to report it.
  static void log(Weight weight, const std::string& words);
  /// Begins to look. `report` must outlive the watch.
  void start(Report report, std::chrono::milliseconds period = usual_period);
  /// Of the certificate that ends first: whole days, below 0 after its end. Any thread; takes no lock.
  std::int64_t days_left() const;

 private:
  struct Pair {
    ClientConfig::TlsPair files;
    crypto::Renewal renewal;
  };

  CertificateWatch(const ClientConfig& ledger, std::unique_ptr<crypto::MspRegistry> trusted);
  void poll();
  void poll_identity(std::int64_t now_s);
  void update_first_end();
  void poll_pair(Pair& pair, std::int64_t now_s);
  std::optional<crypto::Renewal::Pair> renewed(crypto::Renewal& renewal, const std::vector<std::string>& files,
                                               std::int64_t now_s, const crypto::Renewal::Load& load);
  void report_end(crypto::Renewal& renewal, std::int64_t now_s);
  Result<crypto::Renewal::Pair> checked(const Result<crypto::SigningIdentity>& found, std::int64_t now_s) const;

  const crypto::IdentitySource source_;
  const std::shared_ptr<crypto::IdentityInUse> identity_;
  std::unique_ptr<crypto::MspRegistry> trusted_;
  const std::shared_ptr<TlsPairsInUse> in_use_;
  std::vector<Pair> pairs_;
  Report report_;

  crypto::Renewal identity_renewal_;
  std::atomic<std::int64_t> first_end_s_{0};  ///< of all
  std::mutex mutex_;                          ///< of the wait alone
  std::condition_variable_any woken_;
  std::jthread thread_;
};

}  // namespace ledgerline::fabric
