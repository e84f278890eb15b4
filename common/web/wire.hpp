#pragma once
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream_base.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>

namespace ledgerline::web {

/// Beast's handlers are moved and never copied, which std::function does not take.
template <typename Handler>
auto copyable(Handler&& handler) {
  return [held = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler))](auto... results) {
    auto called = std::move(*held);
    called(results...);
  };
}

/// A connection of TCP, with or without TLS on it, as one type for Beast. Buffers and handlers are of one type, too, so
/// that Asio's operations are compiled here alone and not once for each of Beast's. Beside the stream's own functions
/// there is tcp(), which has the time-outs. Handlers run on the io_context's thread, and it has one. Movable.
class Wire {
 public:
  using executor_type = boost::beast::tcp_stream::executor_type;

  /// `tls`: null for none. It need not outlive the wire.
  Wire(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls);
  Wire(boost::asio::io_context& io, boost::asio::ssl::context* tls);
  ~Wire();
  Wire(Wire&&) noexcept;
  Wire& operator=(Wire&&) noexcept;

  boost::beast::tcp_stream& tcp();
  boost::beast::tcp_stream& next_layer() { return tcp(); }  ///< for Beast: the lowest one
  executor_type get_executor();
  /// Null: without TLS.
  SSL* tls();

  using Ended = std::function<void(boost::beast::error_code)>;
  /// Of TLS alone.
  void async_handshake(boost::asio::ssl::stream_base::handshake_type side, Ended ended);
  /// Says that nothing more comes, and waits for the same from the other side.
  void async_shutdown(Ended ended);

  template <typename Buffers, typename Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    read_some(First<boost::asio::mutable_buffer>(buffers), copyable(std::forward<Handler>(handler)));
  }
  template <typename Buffers, typename Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    write_some(First<boost::asio::const_buffer>(buffers), copyable(std::forward<Handler>(handler)));
  }

 private:
  using Transferred = std::function<void(boost::beast::error_code, std::size_t)>;

  /// The first that hold something: what is left is transferred by the next operation.
  template <typename Buffer>
  class First {
   public:
    using value_type = Buffer;
    using const_iterator = const Buffer*;

    template <typename Buffers>
    explicit First(const Buffers& buffers) {
      auto one = boost::asio::buffer_sequence_begin(buffers);
      const auto end = boost::asio::buffer_sequence_end(buffers);
      for (; one != end && count_ < first_.size(); ++one) {
        if (const Buffer buffer(*one); buffer.size() > 0) first_[count_++] = buffer;
      }
    }
    const_iterator begin() const { return first_.data(); }
    const_iterator end() const { return first_.data() + count_; }

   private:
    std::array<Buffer, 16> first_{};
    std::size_t count_ = 0;
  };

  void read_some(const First<boost::asio::mutable_buffer>& buffers, Transferred transferred);
  void write_some(const First<boost::asio::const_buffer>& buffers, Transferred transferred);

  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// How Beast's WebSocket ends its connection.
void end_wire(boost::beast::role_type role, Wire& wire, Wire::Ended ended);
template <typename Handler>
void async_teardown(boost::beast::role_type role, Wire& wire, Handler&& handler) {
  end_wire(role, wire, copyable(std::forward<Handler>(handler)));
}

}  // namespace ledgerline::web
