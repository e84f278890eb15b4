#include "common/web/wire.hpp"

#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <optional>

namespace ledgerline::web {

struct Wire::Parts {
  using Tcp = boost::beast::tcp_stream;
  Tcp tcp;
  std::optional<boost::asio::ssl::stream<Tcp&>> tls{};  // refers to tcp, so neither moves
};

Wire::Wire(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls)
    : parts_(new Parts{.tcp = Parts::Tcp(std::move(socket))}) {
  if (tls) parts_->tls.emplace(parts_->tcp, *tls);
}
Wire::Wire(boost::asio::io_context& io, boost::asio::ssl::context* tls) : Wire(boost::asio::ip::tcp::socket(io), tls) {}
Wire::~Wire() = default;
Wire::Wire(Wire&&) noexcept = default;
Wire& Wire::operator=(Wire&&) noexcept = default;

boost::beast::tcp_stream& Wire::tcp() { return parts_->tcp; }
Wire::executor_type Wire::get_executor() { return parts_->tcp.get_executor(); }
SSL* Wire::tls() { return parts_->tls ? parts_->tls->native_handle() : nullptr; }

void Wire::async_handshake(boost::asio::ssl::stream_base::handshake_type side, Ended ended) {
  parts_->tls->async_handshake(side, std::move(ended));
}
void Wire::async_shutdown(Ended ended) { parts_->tls->async_shutdown(std::move(ended)); }

void Wire::read_some(const First<boost::asio::mutable_buffer>& buffers, Transferred transferred) {
  if (parts_->tls)
    parts_->tls->async_read_some(buffers, std::move(transferred));
  else
    parts_->tcp.async_read_some(buffers, std::move(transferred));
}
void Wire::write_some(const First<boost::asio::const_buffer>& buffers, Transferred transferred) {
  if (parts_->tls)
    parts_->tls->async_write_some(buffers, std::move(transferred));
  else
    parts_->tcp.async_write_some(buffers, std::move(transferred));
}

void end_wire(boost::beast::role_type role, Wire& wire, Wire::Ended ended) {
  if (wire.tls())
    wire.async_shutdown(std::move(ended));
  else
    boost::beast::websocket::async_teardown(role, wire.tcp().socket(), std::move(ended));
}

}  // namespace ledgerline::web
