#include "tools/station/shell/station.hpp"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "common/base/log.hpp"

namespace ledgerline::station {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;

constexpr std::chrono::seconds patience{15};  // unlocking an operator's key takes a part of a second
constexpr std::size_t max_answer_bytes = 16 * 1024 * 1024;
constexpr int max_messages = 1'000;  // of the stream before the first state: hello, blocks, events, paths

tcp::endpoint endpoint_of(const Place& place) { return {asio::ip::make_address_v4(place.address), place.port}; }

Error not_reached(const Place& place, const beast::error_code& error) {
  const std::string why = error == beast::error::timeout        ? "no answer within 15 s"
                          : error == http::error::end_of_stream ? "it closed the connection"
                                                                : error.message();
  return {fmt::format("the station at {} is not reached: {}", text_of(place), why)};
}

}  // namespace

struct Station::Wire {
  asio::io_context io;
  std::optional<beast::tcp_stream> socket{};
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

  beast::error_code connect(const Place& place) {
    socket.emplace(io);
    buffer.clear();
    ++connections;
    socket->expires_after(patience);
    return wait([&](auto ended) { socket->async_connect(endpoint_of(place), ended); });
  }
};

Station::Station(Place place, Credentials credentials)
    : place_(std::move(place)), credentials_(std::move(credentials)), wire_(std::make_unique<Wire>()) {}
Station::~Station() = default;

unsigned Station::connections() const { return wire_->connections; }

Result<Answer> Station::send(const Request& request, const std::string& token) {
  if (!wire_->socket) {
    if (const auto error = wire_->connect(place_)) {
      wire_->socket.reset();
      return not_reached(place_, error);
    }
  }
  http::request<http::string_body> message(http::string_to_verb(request.method), "/api/v1/" + request.target, 11);
  message.set(http::field::host, text_of(place_));
  message.set(http::field::authorization, "Bearer " + token);
  if (request.method != "GET") message.set(http::field::content_type, request.content_type);
  message.body() = request.body;
  message.prepare_payload();
  http::response_parser<http::string_body> parser;
  parser.body_limit(max_answer_bytes);
  beast::tcp_stream& socket = *wire_->socket;
  socket.expires_after(patience);
  beast::error_code error = wire_->wait([&](auto ended) { http::async_write(socket, message, ended); });
  if (!error) error = wire_->wait([&](auto ended) { http::async_read(socket, wire_->buffer, parser, ended); });
  if (error || !parser.get().keep_alive()) wire_->socket.reset();
  if (error) return not_reached(place_, error);
  return Answer{parser.get().result_int(), std::move(parser.get().body())};
}

Result<std::string> Station::ask(const Request& request) {
  const bool signed_in = !credentials_.session.empty();
  auto answer = send(request, signed_in ? credentials_.session : credentials_.token);
  constexpr unsigned unknown_token = 401;
  const bool over = signed_in && answer && answer->status == unknown_token;
  if (over && request.anybodys) {
    spdlog::warn("the session in {} is over: asking without it", credentials_.session_file);
    answer = send(request, credentials_.token);
  }
  if (!answer) return answer.error();
  std::string refusal = refusal_of(*answer);
  if (refusal.empty()) return std::move(answer->body);
  if (over && !request.anybodys)
    refusal += fmt::format("; the session in {} is over: ledgerline drones login", credentials_.session_file);
  return Error{std::move(refusal)};
}

Result<double> Station::now_ms() {
  websocket::stream<beast::tcp_stream> stream(wire_->io);
  beast::get_lowest_layer(stream).expires_after(patience);
  const auto connected = [&](auto ended) { beast::get_lowest_layer(stream).async_connect(endpoint_of(place_), ended); };
  beast::error_code error = wire_->wait(connected);
  if (error) return not_reached(place_, error);
  stream.set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
    request.set(http::field::sec_websocket_protocol, "ledgerline.v1, token." + credentials_.token);
  }));
  stream.read_message_max(max_answer_bytes);
  error = wire_->wait([&](auto ended) { stream.async_handshake(text_of(place_), "/api/v1/stream", ended); });
  for (int i = 0; !error && i < max_messages; ++i) {
    beast::flat_buffer buffer;
    error = wire_->wait([&](auto ended) { stream.async_read(buffer, ended); });
    if (error) break;
    const auto message = nlohmann::json::parse(beast::buffers_to_string(buffer.data()), nullptr, false);
    if (!message.is_object() || message.value("op", nlohmann::json()) != "state") continue;
    const auto t_ms = message.value("t_ms", nlohmann::json());
    if (t_ms.is_number()) return t_ms.get<double>();
    return Error{"the station's state does not say its time"};
  }
  if (!error) return Error{"the station's stream tells no state"};
  if (error == websocket::error::upgrade_declined)
    return Error{fmt::format("the station at {} does not take the token for its stream", text_of(place_))};
  return not_reached(place_, error);
}

}  // namespace ledgerline::station
