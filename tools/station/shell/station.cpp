#include "tools/station/shell/station.hpp"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <optional>
#include <utility>

#include "common/base/log.hpp"
#include "common/web/tls.hpp"
#include "common/web/wire.hpp"

namespace ledgerline::station {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;

constexpr std::chrono::seconds timeout{15};  // unlocking an operator's key takes a part of a second
constexpr std::size_t max_answer_bytes = 16 * 1024 * 1024;

/// Why an address is not reached; empty: it is.
using Trouble = std::string;

Trouble words_of(const beast::error_code& error) {
  if (!error) return "";
  if (error == beast::error::timeout) return "no answer within 15 s";
  if (error == http::error::end_of_stream) return "it closed the connection";
  return error.message();
}

Error not_reached(const StationAddress& address, const Trouble& why) {
  return {fmt::format("the station at {} is not reached: {}", text_of(address), why)};
}

}  // namespace

struct Station::Client {
  asio::io_context io;
  web::TlsContext tls{};  ///< null: the station has none
  std::optional<web::Wire> wire{};
  beast::flat_buffer buffer{};
  unsigned connections = 0;

  /// Until what was begun has ended.
  template <typename Begin>
  beast::error_code wait(const Begin& begin) {
    beast::error_code result;
    begin([&result](beast::error_code error, auto&&...) { result = error; });
    io.restart();
    io.run();
    return result;
  }

  /// With TLS its handshake is done, and the other side is that host.
  Trouble connect(const StationAddress& address, web::Wire& to) {
    tcp::resolver resolver(io);
    beast::error_code error;
    const auto found =
        resolver.resolve(address.at.host, std::to_string(address.at.port), tcp::resolver::numeric_service, error);
    if (error) return words_of(error);
    to.tcp().expires_after(timeout);
    error = wait([&](auto ended) { to.tcp().async_connect(found, ended); });
    if (error || !tls) return words_of(error);
    web::expect_host(to.tls(), address.at.host);
    error = wait([&](auto ended) { to.async_handshake(asio::ssl::stream_base::client, ended); });
    if (!error) return "";
    const std::string fault = web::certificate_fault(to.tls());
    return fault.empty() ? "TLS: " + words_of(error) : "its certificate is not trusted: " + fault;
  }
};

Result<std::unique_ptr<Station>> Station::open(StationAddress address, Credentials credentials) {
  auto client = std::make_unique<Client>();
  if (address.tls) {
    auto tls = web::client_tls(credentials.tls);
    if (!tls) return tls.error();
    client->tls = std::move(*tls);
  }
  return std::unique_ptr<Station>(new Station(std::move(address), std::move(credentials), std::move(client)));
}

Station::Station(StationAddress address, Credentials credentials, std::unique_ptr<Client> client)
    : address_(std::move(address)), credentials_(std::move(credentials)), client_(std::move(client)) {}
Station::~Station() = default;

unsigned Station::connections() const { return client_->connections; }

Result<Answer> Station::send(const Request& request, const std::string& token) {
  if (!client_->wire) {
    client_->wire.emplace(client_->io, client_->tls.get());
    client_->buffer.clear();
    ++client_->connections;
    if (const Trouble trouble = client_->connect(address_, *client_->wire); !trouble.empty()) {
      client_->wire.reset();
      return not_reached(address_, trouble + credentials_.hint);
    }
  }
  http::request<http::string_body> message(http::string_to_verb(request.method), "/api/v1/" + request.target, 11);
  message.set(http::field::host, text_of(address_));
  message.set(http::field::authorization, "Bearer " + token);
  if (request.method != "GET") message.set(http::field::content_type, request.content_type);
  message.body() = request.body;
  message.prepare_payload();
  http::response_parser<http::string_body> parser;
  parser.body_limit(max_answer_bytes);
  web::Wire& wire = *client_->wire;
  wire.tcp().expires_after(timeout);
  beast::error_code error = client_->wait([&](auto ended) { http::async_write(wire, message, ended); });
  if (!error) error = client_->wait([&](auto ended) { http::async_read(wire, client_->buffer, parser, ended); });
  if (error || !parser.get().keep_alive()) client_->wire.reset();
  if (error) return not_reached(address_, words_of(error) + credentials_.hint);
  return Answer{parser.get().result_int(), std::move(parser.get().body())};
}

Result<std::string> Station::request(const Request& request) {
  const bool signed_in = !credentials_.session.empty();
  auto answer = send(request, signed_in ? credentials_.session : credentials_.token);
  constexpr unsigned unknown_token = 401;
  const bool over = signed_in && answer && answer->status == unknown_token;
  if (over && request.anybodys) {
    spdlog::warn("the session in {} is over: asking without it", credentials_.session_file);
    answer = send(request, credentials_.token);
  }
  if (!answer) return answer.error();
  const Status taken = check_answer(*answer);
  if (taken) return std::move(answer->body);
  std::string refusal = taken.error().message;
  if (over && !request.anybodys)
    refusal += fmt::format("; the session in {} is over: ledgerline drones login", credentials_.session_file);
  else if (answer->status == unknown_token)
    refusal =
        fmt::format("the token in {} is not that of the station at {}", credentials_.token_file, text_of(address_));
  return Error{std::move(refusal)};
}

}  // namespace ledgerline::station
