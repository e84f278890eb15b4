#include "ground/service/shell/server.hpp"

#include <fmt/format.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <deque>
#include <mutex>
#include <set>
#include <thread>

#include "common/base/ipv4.hpp"
#include "common/base/log.hpp"
#include "common/rt/clock.hpp"
#include "ground/service/shell/hub.hpp"
#include "ground/service/shell/sessions.hpp"

namespace ledgerline::ground::service {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

struct Place {
  std::string address;
  std::uint16_t port = 0;
};

Result<Place> place_from(const std::string& listen) {
  const auto colon = listen.rfind(':');
  const std::string address = listen.substr(0, colon);
  const auto parsed = parse_ipv4(address);
  if (colon == std::string::npos || !parsed) return Error{"must be ADDRESS:PORT, as 127.0.0.1:8800"};
  if (*parsed >> 24 != 127)
    return Error{
        "must be of this computer alone (127.0.0.1:PORT): there is no TLS here; from elsewhere take an SSH tunnel"};
  const std::string digits = listen.substr(colon + 1);
  const bool number =
      !digits.empty() && digits.size() <= 5 && digits.find_first_not_of("0123456789") == std::string::npos;
  if (!number || std::stoul(digits) > 65'535) return Error{"must end in a port from 0 (any) to 65535"};
  return Place{address, static_cast<std::uint16_t>(std::stoul(digits))};
}

class BeastServer final : public Server {
 public:
  BeastServer(std::vector<std::string> drones, const Greeting& greeting, Behind behind, TimeNs session_idle_ns)
      : hub_(std::move(drones), greeting, std::move(behind), session_idle_ns),
        acceptor_(io_),
        again_(io_),
        expiry_(io_) {}
  ~BeastServer() override {
    io_.stop();
    if (thread_.joinable()) thread_.join();
  }

  Status listen(const Place& place, const std::string& token) {
    boost::system::error_code error;
    const tcp::endpoint at(asio::ip::make_address_v4(place.address), place.port);
    acceptor_.open(at.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
    if (!error) acceptor_.bind(at, error);
    if (!error) acceptor_.listen(128, error);
    if (error) return Error{fmt::format("cannot listen on {}:{}: {}", place.address, place.port, error.message())};
    const std::uint16_t port = acceptor_.local_endpoint().port();
    url_ = fmt::format("http://{}:{}", place.address, port);
    guard_.emplace(token, place.address, port);
    accept();
    expire_sessions();
    thread_ = std::thread([this] { serve(); });
    return done;
  }

  void publish(Telling telling) override {
    asio::post(io_, [this, telling = std::move(telling)]() mutable { hub_.publish(std::move(telling)); });
  }
  void publish_blocks(std::vector<BlockSummary> blocks) override {
    asio::post(io_, [this, blocks = std::move(blocks)] { hub_.publish_blocks(blocks); });
  }
  void publish_missions(std::string list) override {
    asio::post(io_, [this, list = std::move(list)] { hub_.publish_missions(list); });
  }
  void end() override {
    asio::post(io_, [this] {
      boost::system::error_code ignored;  // it is no matter whether it was open
      acceptor_.close(ignored);
      again_.cancel();
      expiry_.cancel();
      hub_.end();
    });
    const TimeNs until = monotonic_ns() + 500 * ns_per_ms;
    while (hub_.connections() > 0 && monotonic_ns() < until) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  bool watched() const override { return hub_.streams() > 0; }
  std::string url() const override { return url_; }

 private:
  // Whatever goes wrong here is no reason for a flight to end.
  void serve() {
    try {
      io_.run();
    } catch (const std::exception& problem) {
      spdlog::error("ground's page has ended, the flight goes on: {}", problem.what());
    }
  }

  void expire_sessions() {
    expiry_.expires_after(std::chrono::seconds(1));
    expiry_.async_wait([this](boost::system::error_code ended) {
      if (ended) return;
      hub_.expire(monotonic_ns());
      expire_sessions();
    });
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
      hub_.make_room();
      // Beyond the bound a connection is closed at once; the pages that are open go on.
      if (hub_.connections() < max_connections) serve_http(std::move(socket), hub_, *guard_);
      accept();
    });
  }

  // Before io_, whose end ends the connections that still wait: they speak to both.
  Hub hub_;
  std::optional<Guard> guard_;
  asio::io_context io_{1};
  tcp::acceptor acceptor_;
  asio::steady_timer again_, expiry_;
  std::string url_;
  std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<Server>> Server::start(const ServiceSettings& settings, std::vector<std::string> drones,
                                              const Greeting& greeting, Behind behind) {
  const auto place = place_from(settings.listen);
  if (!place) return Error{"[service] listen " + place.error().what};
  const auto token = read_token(settings.token_file);
  if (!token) return Error{"[service] token_file: " + token.error().what};
  auto server = std::make_unique<BeastServer>(std::move(drones), greeting, std::move(behind), settings.session_idle_ns);
  if (auto status = server->listen(*place, *token); !status) return status.error();
  return std::unique_ptr<Server>(std::move(server));
}

}  // namespace ledgerline::ground::service
