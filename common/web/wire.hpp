#pragma once
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <memory>
#include <optional>
#include <utility>

namespace ledgerline::web {

/// A connection of TCP, with or without TLS on it, as one type for Beast: what is written for one serves both, and is
/// compiled once. Beside the stream's own functions there is tcp(), which has the time-outs. Movable; one thread.
class Wire {
 public:
  using executor_type = boost::beast::tcp_stream::executor_type;

  /// `tls`: null for none. It need not outlive the wire.
  template <typename Socket>
  Wire(Socket&& socket, boost::asio::ssl::context* tls) : parts_(new Parts{.tcp = Tcp(std::forward<Socket>(socket))}) {
    if (tls) parts_->tls.emplace(parts_->tcp, *tls);
  }

  boost::beast::tcp_stream& tcp() { return parts_->tcp; }
  boost::beast::tcp_stream& next_layer() { return parts_->tcp; }  ///< for Beast: the lowest one
  executor_type get_executor() { return parts_->tcp.get_executor(); }
  /// Null: without TLS.
  SSL* tls() { return parts_->tls ? parts_->tls->native_handle() : nullptr; }

  /// Of TLS alone.
  template <typename Handler>
  void async_handshake(boost::asio::ssl::stream_base::handshake_type side, Handler&& handler) {
    parts_->tls->async_handshake(side, std::forward<Handler>(handler));
  }
  /// Says that nothing more comes, and waits for the same from the other side.
  template <typename Handler>
  void async_shutdown(Handler&& handler) {
    parts_->tls->async_shutdown(std::forward<Handler>(handler));
  }

  template <typename Buffers, typename Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (parts_->tls)
      parts_->tls->async_read_some(buffers, std::forward<Handler>(handler));
    else
      parts_->tcp.async_read_some(buffers, std::forward<Handler>(handler));
  }
  template <typename Buffers, typename Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (parts_->tls)
      parts_->tls->async_write_some(buffers, std::forward<Handler>(handler));
    else
      parts_->tcp.async_write_some(buffers, std::forward<Handler>(handler));
  }

 private:
  using Tcp = boost::beast::tcp_stream;
  struct Parts {
    Tcp tcp;
    std::optional<boost::asio::ssl::stream<Tcp&>> tls{};
  };
  std::unique_ptr<Parts> parts_;  // TLS refers to TCP, so they do not move
};

/// How Beast's WebSocket ends its connection.
template <typename Handler>
void async_teardown(boost::beast::role_type role, Wire& wire, Handler&& handler) {
  if (wire.tls())
    wire.async_shutdown(std::forward<Handler>(handler));
  else
    boost::beast::websocket::async_teardown(role, wire.tcp().socket(), std::forward<Handler>(handler));
}

}  // namespace ledgerline::web
