#include "chaincode/endorser/shell/service.hpp"

#include <atomic>
#include <memory>
#include <utility>
#include <vector>

#include "common/base/log.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/tls/certificate_watch.hpp"

namespace ledgerline::endorser {
namespace {

class InProcessEndorser final : public fabric::OwnEndorser, public std::enable_shared_from_this<InProcessEndorser> {
 public:
  InProcessEndorser(std::unique_ptr<Service> service, std::string summary,
                    std::unique_ptr<fabric::CertificateWatch> certificates)
      : service_(std::move(service)), summary_(std::move(summary)), certificates_(std::move(certificates)) {}
  ~InProcessEndorser() override {
    certificates_.reset();
    served_.reset();
    if (summary_.empty()) return;
    if (const Status s = write_summary(summary_, service_->counts()); !s)
      spdlog::error("own_endorser.summary: {}", s.error().message);
  }
  InProcessEndorser(const InProcessEndorser&) = delete;
  InProcessEndorser& operator=(const InProcessEndorser&) = delete;

  Status serve(const ServeSettings& settings, std::shared_ptr<const fabric::TlsPairsInUse> tls) {
    auto served = endorser::serve(*service_, settings, "own_endorser.", std::move(tls));
    if (!served) return served.error();
    served_ = std::move(*served);
    return done;
  }

  void watch() { certificates_->start(fabric::CertificateWatch::log); }

  Answer endorse(const std::string& signed_proposal) override {
    node::Reply reply = service_->process_proposal(signed_proposal, Service::Caller::own);
    if (reply.code == node::Code::ok) return {.response = std::move(reply.bytes)};
    return {.response = Error{std::move(reply.message)}, .elsewhere = reply.code == node::Code::unavailable};
  }

  fabric::Client::StreamHandlers fed_by(fabric::Client::StreamHandlers handlers) override {
    if (fed_.exchange(true)) return handlers;
    const auto self = shared_from_this();
    handlers.on_block = [self, then = std::move(handlers.on_block)](const fabric::Block& block, std::string_view raw) {
      if (then) then(block, raw);
      self->on_block(block, raw);
    };
    handlers.on_connection = [self, then = std::move(handlers.on_connection)](bool connected, const std::string& why) {
      if (then) then(connected, why);
      self->service_->on_shared_connection(connected, why);
    };
    handlers.on_confirmed = [self, then = std::move(handlers.on_confirmed)](const auto& confirmed) {
      if (then) then(confirmed);
      self->service_->on_shared_confirmed(confirmed.number, confirmed.hash);
    };
    handlers.on_contradiction = [self, then = std::move(handlers.on_contradiction)](const std::string& what) {
      if (then) then(what);
      self->service_->fail(what);
    };
    return handlers;
  }

 private:
  void on_block(const fabric::Block& block, std::string_view raw) {
    for (const fabric::Transaction& transaction : block.transactions) {
      if (transaction.problem.empty()) continue;
      service_->fail("a transaction's flag is not trusted: " + transaction.problem);
      return;
    }
    service_->on_shared_block(block, raw);
  }

  const std::unique_ptr<Service> service_;
  const std::string summary_;
  std::unique_ptr<fabric::CertificateWatch> certificates_;
  std::atomic<bool> fed_{false};
  std::unique_ptr<Server> served_;
};

}  // namespace

Status start_own_endorser(const Settings& settings, fabric::ClientConfig& ledger) {
  if (settings.msp_dir.empty()) return done;
  if (ledger.orderers.empty())
    return Error{"own_endorser: what it endorses goes to an orderer, and no [[orderer]] is named"};
  fabric::ClientConfig own = ledger;
  own.blocks = fabric::BlockSource::peer;
  auto identity = crypto::load_identity(crypto::Library::libcrypto, own.identity.name.msp_id, settings.msp_dir);
  if (!identity) return Error{"own_endorser.msp_dir: " + identity.error().message};
  own.identity = std::move(*identity);
  own.identity_source = {crypto::Library::libcrypto, own.identity.name.msp_id, settings.msp_dir, {}};
  // The TLS pairs of [ledger] are watched by who made `ledger`.
  fabric::ClientConfig watched;
  watched.identity = own.identity;
  watched.identity_source = own.identity_source;
  std::vector<fabric::ClientConfig::TlsPair> served;
  if (!settings.serve.listen.empty()) served.push_back({settings.serve.tls_certificate, settings.serve.tls_key});
  auto certificates = fabric::CertificateWatch::create(watched, nullptr, served);
  if (!certificates) return Error{"own_endorser.tls_certificate and tls_key: " + certificates.error().message};
  own.identity = watched.identity;
  auto service = Service::start(std::move(own), settings, [] {});
  if (!service) return Error{"own_endorser: " + service.error().message};
  auto within = std::make_shared<InProcessEndorser>(std::move(*service), settings.summary, std::move(*certificates));
  if (!settings.serve.listen.empty()) {
    if (Status s = within->serve(settings.serve, watched.tls_in_use); !s) return s;
  }
  within->watch();
  ledger.own_endorser = std::move(within);
  return done;
}

Status check_channels(const Settings& settings, const fabric::Channels& channels) {
  if (settings.msp_dir.empty() || !channels.several()) return done;
  return Error{"[own_endorser] is of one channel: beside [[channel]] each needs an endorser of its own"};
}

}  // namespace ledgerline::endorser
