#include "ground/service/shell/hub.hpp"

#include <algorithm>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <utility>

#include "common/rt/clock.hpp"
#include "ground/service/core/guard.hpp"
#include "ground/service/core/stream_messages.hpp"

namespace ledgerline::ground::service {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using Request = http::request<http::string_body>;

constexpr double messages_per_s = 100;  // a pilot's velocities come fifteen times a second
constexpr std::size_t max_message_bytes = 4096;
constexpr std::size_t max_answers = 16;  // to who asks without reading; the newest tell most

/// The stream to one client. One write at a time: behind it the events it lacks, then the newest state.
class Stream final : public Hub::Listener, public std::enable_shared_from_this<Stream> {
 public:
  Stream(web::Wire&& socket, Hub& hub, StreamSlots slots, std::optional<SignIns::Session> session)
      : socket_(std::move(socket)), hub_(hub), slots_(std::move(slots)), session_(session), budget_(messages_per_s) {}

  void start(const Request& request) {
    socket_.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
    socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
      response.set(http::field::sec_websocket_protocol, "ledgerline.v1");
    }));
    socket_.read_message_max(max_message_bytes);
    socket_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return;
      self->reported_ = self->hub_.forgotten_event();
      self->hub_.join(std::shared_ptr<Hub::Listener>(self));
      self->send(std::make_shared<const std::string>(self->hub_.greeting()));
      self->read();
    });
  }

  void on_update() override {
    // A page that is open keeps its operator signed in.
    if (session_ && !closing_ && !hub_.sign_ins().touch(monotonic_ns(), *session_)) close("the session is over");
    if (writing_ || closing_) {
      // Who has not taken a write for so many events will not catch up, and may come again.
      const auto& events = hub_.events();
      if (!closing_ && !events.empty() && events.front().number > reported_ + 1) close("a thousand events behind");
      return;
    }
    if (!answers_.empty()) {
      auto text = std::make_shared<const std::string>(std::move(answers_.front()));
      answers_.pop_front();
      return send(std::move(text));
    }
    if (hub_.newest_block() > reported_block_ && !blocks_were_last_) {  // by turns, so that neither waits for the other
      const std::uint64_t reported = std::exchange(reported_block_, hub_.newest_block());
      send(std::make_shared<const std::string>(blocks_message(hub_.blocks(), reported)));
      blocks_were_last_ = true;
      return;
    }
    const auto& events = hub_.events();
    if (hub_.newest_event() > reported_) {
      const std::size_t missing = std::min<std::size_t>(hub_.newest_event() - reported_, events.size());
      reported_ = hub_.newest_event();
      send(std::make_shared<const std::string>(events_message(events, events.size() - missing)));
      return;
    }
    using Messages = Hub::Messages;
    for (const auto part : {&Messages::paths, &Messages::missions, &Messages::faults, &Messages::state}) {
      const auto& newest = hub_.messages().*part;
      if (newest && newest != sent_.*part) return send(sent_.*part = newest);
    }
    if (hub_.ended()) close("the ground has ended", websocket::close_code::going_away);
  }

 private:
  void send(std::shared_ptr<const std::string> text) {
    writing_ = true;
    blocks_were_last_ = false;
    socket_.text(true);
    const auto buffer = boost::asio::buffer(*text);
    socket_.async_write(buffer,
                        [self = shared_from_this(), text = std::move(text)](beast::error_code error, std::size_t) {
                          self->writing_ = false;
                          if (!error) self->on_update();
                        });
  }

  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return;
      self->on_message();
    });
  }

  void on_message() {
    if (closing_) return;
    const TimeNs now = monotonic_ns();
    const auto text = beast::buffers_to_string(buffer_.data());
    buffer_.consume(buffer_.size());
    const bool in_budget = budget_.spend(now);
    const bool in_session = session_ && hub_.sign_ins().touch(now, *session_);
    StreamClient client{.session_ended = session_ && !in_session};
    if (in_session) client.who = session_->who;
    auto said = read_stream_message(text, client, hub_.known(), now);
    if (!said) return close(said.error().message);
    // A budget is no reason to keep a drone in the air.
    if (!in_budget && !(said->command && lands(said->command->made))) return close("more than 100 messages a second");
    if (said->command) {
      bring_down(*said->command);
    } else if (const Status flown = fly(client, std::move(*said->velocity)); !flown) {
      return close(flown.error().message);
    }
    read();
  }

  static bool lands(const ApiAnswer& made) { return std::ranges::any_of(made.commands, brings_down); }

  Status fly(const StreamClient& client, PilotCommand velocity) {
    if (!hub_.operators().empty()) {
      if (!session_) return Error{"sign in first: who flies is who signs"};
      if (!client.who) return Error{"the session is over"};
      velocity.by = hub_.operators()[*client.who].identity;
    }
    // One that is not taken now would not be flown, either: nothing is in the air yet.
    return hub_.post_command(velocity);
  }

  void bring_down(StreamCommand& command) {
    for (const PilotCommand& one : std::exchange(command.made.commands, {})) {
      if (const Status taken = hub_.post_command(one); !taken) command.made = refusal(503, taken.error().message);
    }
    if (!command.id) return;
    if (answers_.size() == max_answers) answers_.pop_front();
    answers_.push_back(answer_message(*command.id, command.made));
    on_update();
  }

  // What it wrote wrong it would write wrong again; the words are in the close frame.
  void close(const std::string& why, websocket::close_code code = websocket::close_code::policy_error) {
    if (closing_) return;
    closing_ = true;
    if (writing_) {  // a close frame would have to wait behind a write that nobody takes
      beast::get_lowest_layer(socket_).cancel();
      beast::get_lowest_layer(socket_).close();
      return;
    }
    websocket::close_reason reason(code);
    reason.reason = why.substr(0, 120);  // a control frame has room for 123 bytes
    socket_.async_close(reason, [self = shared_from_this()](beast::error_code) {});
  }

  websocket::stream<web::Wire, false> socket_;
  Hub& hub_;
  const StreamSlots slots_;
  const std::optional<SignIns::Session> session_;
  Budget budget_;
  beast::flat_buffer buffer_;
  std::deque<std::string> answers_;  ///< not sent yet, oldest first
  Hub::Messages sent_;               ///< the newest of each
  std::uint64_t reported_ = 0;       ///< the newest event that it has
  std::uint64_t reported_block_ = 0;
  bool blocks_were_last_ = false;
  bool writing_ = false, closing_ = false;
};

}  // namespace

void serve_stream(web::Wire wire, Hub& hub, StreamSlots slots, std::optional<SignIns::Session> session,
                  const Request& request) {
  std::make_shared<Stream>(std::move(wire), hub, std::move(slots), session)->start(request);
}

}  // namespace ledgerline::ground::service
