#include "ground/service/shell/server.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sys/stat.h>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <optional>
#include <thread>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/crypto/crypto.hpp"
#include "common/crypto/identities/renewal.hpp"
#include "common/rt/clock.hpp"
#include "common/web/tls.hpp"
#include "ground/service/shell/hub.hpp"

namespace ledgerline::ground::service {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

class BeastServer final : public Server {
 public:
  BeastServer(std::vector<std::string> drones, const Greeting& greeting, const Handlers& handlers,
              TimeNs session_idle_ns, std::optional<web::RenewedTls> tls)
      : hub_(std::move(drones), greeting, handlers, session_idle_ns),
        report_(handlers.report),
        tls_(std::move(tls)),
        acceptor_(io_),
        again_(io_),
        each_second_(io_) {}
  ~BeastServer() override {
    io_.stop();
    if (thread_.joinable()) thread_.join();
    answers_.close();
  }

  Status listen(const ServiceSettings& settings, const std::string& token) {
    const web::HostPort listen = *web::host_port_from(settings.listen);
    boost::system::error_code error;
    const tcp::endpoint at(asio::ip::make_address(listen.host), listen.port);
    acceptor_.open(at.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    // "::" takes IPv4's clients, too, however the host is set.
    if (!error && at.address().is_v6()) acceptor_.set_option(asio::ip::v6_only(false), error);
    if (!error) acceptor_.bind(at, error);
    if (!error) acceptor_.listen(128, error);
    if (error) return Error{fmt::format("cannot listen on {}: {}", settings.listen, error.message())};
    const std::uint16_t port = acceptor_.local_endpoint().port();
    url_ = url_of(settings, port);
    guard_.emplace(token, hosts_of(settings, port), settings.has_tls());
    accept();
    look_each_second();
    thread_ = std::thread([this] { serve(); });
    return done;
  }

  void publish(BoardState board) override {
    asio::post(io_, [this, board = std::move(board)]() mutable { hub_.publish(std::move(board)); });
  }
  void publish_blocks(std::vector<BlockSummary> blocks) override {
    asio::post(io_, [this, blocks = std::move(blocks)] { hub_.publish_blocks(blocks); });
  }
  void publish_missions(std::string list) override {
    asio::post(io_, [this, list = std::move(list)] { hub_.publish_missions(list); });
  }
  void publish_faults(FaultList list) override {
    asio::post(io_, [this, list = std::move(list)]() mutable { hub_.publish_faults(std::move(list)); });
  }
  void dismiss(std::vector<std::size_t> who) override {
    asio::post(io_, [this, who = std::move(who)]() mutable {
      for (const std::size_t ended : hub_.sign_ins().dismiss(std::move(who))) hub_.keys().on_session_over(ended);
    });
  }
  void end() override {
    asio::post(io_, [this] {
      boost::system::error_code ignored;  // it is no matter whether it was open
      acceptor_.close(ignored);
      again_.cancel();
      each_second_.cancel();
      hub_.end();
    });
    const TimeNs until = monotonic_ns() + 500 * ns_per_ms;
    while (hub_.connections().count() > 0 && monotonic_ns() < until)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  bool watched() const override { return hub_.streams() > 0; }
  std::string url() const override { return url_; }

 private:
  // Whatever goes wrong here is no reason for a flight to end.
  void serve() {
    ::pthread_setname_np(::pthread_self(), "page");
    try {
      io_.run();
    } catch (const std::exception& problem) {
      spdlog::error("ground's page has ended, the flight goes on: {}", problem.what());
    }
  }

  void look_each_second() {
    each_second_.expires_after(std::chrono::seconds(1));
    each_second_.async_wait([this](boost::system::error_code ended) {
      if (ended) return;
      hub_.expire(monotonic_ns());
      renew_tls();
      look_each_second();
    });
  }

  void renew_tls() {
    if (!tls_) return;
    if (const auto renewed = tls_->renew()) {
      near_end_said_ = near_end_said_ && !*renewed;
      if (*renewed)
        report(Level::info, "ground's page has a new TLS certificate");
      else
        report(Level::warning, "ground's page keeps its old TLS certificate: " + renewed->error().message);
    }
    // A user who cannot open the page cannot press its stop.
    const std::int64_t left_s = tls_->seconds_left();
    if (near_end_said_ || left_s >= crypto::renew_within_days * crypto::day_s) return;
    near_end_said_ = true;
    report(Level::warning,
           left_s < 0
               ? std::string("the TLS certificate of ground's page has run out: browsers refuse it")
               : fmt::format("the TLS certificate of ground's page runs out in {}", crypto::span_in_words(left_s)));
  }

  void report(Level level, const std::string& words) {
    spdlog::log(level == Level::info ? spdlog::level::info : spdlog::level::warn, "{}", words);
    if (report_) report_(level, words);
  }

  void accept() {
    acceptor_.async_accept([this](boost::system::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) {
        // Out of descriptors, for one: it would fail again at once.
        spdlog::warn("ground's page: a connection could not be taken: {}", error.message());
        again_.expires_after(std::chrono::seconds(1));
        again_.async_wait([this](boost::system::error_code ended) {
          if (!ended) accept();
        });
        return;
      }
      hub_.connections().make_room();
      // A state is several writes: none waits until the other side has acknowledged the one before.
      socket.set_option(tcp::no_delay(true), error);
      web::Wire wire(std::move(socket), tls_ ? &tls_->context() : nullptr);
      serve_http(std::move(wire), hub_, answers_, *guard_);
      accept();
    });
  }

  // Before io_, whose end ends the connections that are still open: they speak to both.
  Hub hub_;
  const std::function<void(Level, std::string)> report_;
  std::optional<web::RenewedTls> tls_;
  std::optional<Guard> guard_;
  asio::io_context io_{1};
  Answers answers_{io_};
  tcp::acceptor acceptor_;
  asio::steady_timer again_, each_second_;
  bool near_end_said_ = false;
  std::string url_;
  std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<Server>> Server::start(const ServiceSettings& settings, std::vector<std::string> drones,
                                              const Greeting& greeting, Handlers handlers) {
  if (const auto errors = errors_of(settings); !errors.empty())
    return Error{fmt::format("[service] {} {}", errors[0].key, errors[0].what)};
  const auto token = read_token(settings.token_file);
  if (!token) return Error{"[service] token_file: " + token.error().message};
  std::optional<web::RenewedTls> tls;
  if (settings.has_tls()) {
    auto opened = web::RenewedTls::open(settings.tls);
    if (!opened) return Error{"[service] TLS: " + opened.error().message};
    tls = std::move(*opened);
  }
  auto server =
      std::make_unique<BeastServer>(std::move(drones), greeting, handlers, settings.session_idle_ns, std::move(tls));
  if (auto status = server->listen(settings, *token); !status) return status.error();
  return std::unique_ptr<Server>(std::move(server));
}

Result<std::string> read_token(const std::string& file) {
  if (file.empty()) return Error{"must name a file: anyone who knows what is in it may fly"};
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) {
    const std::string token = crypto::hex(crypto::random_bytes(token_digits / 2));
    if (auto written = replace_file(file, token + "\n", 0600); !written) return written.error();
    return token;
  }
  if ((status.st_mode & 077) != 0) return Error{file + " may be read by others: chmod 600 " + file};
  auto text = read_file(file);
  if (!text) return text.error();
  while (!text->empty() && text->back() == '\n') text->pop_back();
  if (text->empty()) return Error{file + " is empty: remove it, and a new one is made"};
  if (text->size() != token_digits || text->find_first_not_of("0123456789abcdef") != std::string::npos)
    return Error{file + " must hold 64 hex digits; without the file a new one is made"};
  return text;
}

}  // namespace ledgerline::ground::service
