#include "ground/service/shell/hub.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>

#include "common/crypto/crypto.hpp"
#include "common/crypto/identities/wiping_string.hpp"
#include "common/rt/clock.hpp"
#include "common/web/tls.hpp"
#include "ground/service/shell/page_files.hpp"

namespace ledgerline::ground::service {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::asio::ip::tcp;
using Request = http::request<http::string_body>;
using Response = http::response<http::string_body>;

constexpr std::chrono::seconds timeout{10};     // of a handshake, a head, a body, an answer: each as a whole
constexpr std::chrono::seconds keep_alive{60};  // who keeps a slot is waited for: his next request may be a stop
constexpr std::chrono::seconds end_timeout{1};  // of the other side's last word in TLS
// A month, and only for names: it holds for every port of the host, and localhost has other services.
constexpr const char* https_only = "max-age=2592000";
constexpr double requests_per_s = 100;             // of one connection
constexpr std::size_t max_head_bytes = 32 * 1024;  // cookies of every other server on localhost come with a request
constexpr const char* role_taken = "the ledger knows this operator as none any more: nothing is signed for him";

const std::string& policy() {
  static const std::string words =
      std::string("default-src 'none'; script-src 'self' ") + page_scripts +
      "; style-src 'self'; connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
      "frame-ancestors 'none'";
  return words;
}

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

Head head_of(const Request& request) {
  return {.host = view(request[http::field::host]),
          .origin = view(request[http::field::origin]),
          .authorization = view(request[http::field::authorization]),
          .subprotocols = view(request[http::field::sec_websocket_protocol]),
          .websocket = websocket::is_upgrade(request)};
}

Response respond(const Request& request, unsigned status, std::string body, const char* type) {
  Response response{http::int_to_status(status), request.version()};
  response.set(http::field::server, "ledgerline-ground");
  response.set(http::field::content_type, type);
  response.set(http::field::cache_control, "no-store");
  response.set("Content-Security-Policy", policy());
  response.set("X-Content-Type-Options", "nosniff");
  response.set("Referrer-Policy", "no-referrer");
  response.keep_alive(request.keep_alive());
  response.body() = std::move(body);
  response.prepare_payload();
  return response;
}
Response respond(const Request& request, ApiAnswer answer) {
  return respond(request, answer.status, std::move(answer.body), "application/json");
}

const char* type_of(std::string_view name) {
  const auto ends = [&](std::string_view end) {
    return name.size() >= end.size() && name.substr(name.size() - end.size()) == end;
  };
  if (ends(".html")) return "text/html; charset=utf-8";
  if (ends(".js")) return "text/javascript; charset=utf-8";
  if (ends(".css")) return "text/css; charset=utf-8";
  if (ends(".txt")) return "text/plain; charset=utf-8";
  if (ends(".svg")) return "image/svg+xml";
  return "application/octet-stream";
}

Response page(const Request& request) {
  constexpr std::string_view folder = "/page/";
  const std::string_view target = view(request.target());
  std::string_view name = target == "/" ? "index.html" : "";
  if (target.substr(0, folder.size()) == folder) name = target.substr(folder.size());
  if (request.method() != http::verb::get) return respond(request, refusal(405, "GET it"));
  for (std::size_t i = 0; i < page_file_count; ++i) {
    const PageFile& file = page_files[i];
    if (name != file.name) continue;
    if (file.gzip && request[http::field::accept_encoding].find("gzip") == beast::string_view::npos)
      return respond(request, refusal(406, "this file is served compressed: accept gzip"));
    Response found =
        respond(request, 200, std::string(reinterpret_cast<const char*>(file.bytes), file.size), type_of(name));
    if (file.gzip) found.set(http::field::content_encoding, "gzip");
    return found;
  }
  return respond(request, refusal(404, "there is / and what it loads, and the API below /api/v1/"));
}

class HttpSession final : public Connections::Unauthenticated, public std::enable_shared_from_this<HttpSession> {
 public:
  HttpSession(web::Wire&& wire, Hub& hub, Answers& answers, const Guard& guard)
      : wire_(std::move(wire)),
        hub_(hub),
        answers_(answers),
        guard_(guard),
        counted_(hub.connections().count_one()),
        budget_(requests_per_s) {
    beast::error_code gone;
    const auto other = wire_.tcp().socket().remote_endpoint(gone);
    if (!gone) address_ = address_of(other.address().to_string());
  }

  void start() {
    if (!wire_.tls()) return read();
    wire_.tcp().expires_after(timeout);
    wire_.async_handshake(boost::asio::ssl::stream_base::server, [self = shared_from_this()](beast::error_code error) {
      self->has_ended_handshake_ = !error;
      if (!error) return self->read();
      if (web::is_plain_http(error)) self->say_https();
    });
  }

  bool is_unauthenticated() const override { return !kept_; }
  UnauthenticatedClient now() const override { return {address_, has_ended_handshake_}; }
  void close() override { wire_.tcp().close(); }

 private:
  // Somebody has typed http://. He asks once, and hears what to do; nothing of what he sent is read.
  void say_https() {
    static constexpr std::string_view words = "this port speaks TLS: https://\n";
    static const std::string answer = fmt::format(
        "HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{}",
        words.size(), words);
    wire_.tcp().expires_after(end_timeout);
    boost::asio::async_write(wire_.tcp(), boost::asio::buffer(answer),
                             [self = shared_from_this()](beast::error_code, std::size_t) {});
  }

  void read() {
    parser_.emplace();
    parser_->body_limit(max_mission_body_bytes);  // until the head says what it is
    parser_->header_limit(max_head_bytes);
    wire_.tcp().expires_after(kept_ ? keep_alive : timeout);
    http::async_read_header(wire_, buffer_, *parser_,
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              error ? self->on_read(error) : self->read_body();
                            });
  }

  // A mission is long, and only who knows the token may send one.
  void read_body() {
    const Request& request = parser_->get();
    const bool known = admission_of(head_of(request)).refused.status == 0;
    const std::size_t limit = known ? body_limit(view(request.target())) : max_body_bytes;
    if (parser_->content_length().value_or(0) > limit) return on_read(http::error::body_limit);
    parser_->body_limit(limit);
    wire_.tcp().expires_after(timeout);
    http::async_read(wire_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) { self->on_read(error); });
  }

  void on_read(beast::error_code error) {
    if (error == http::error::body_limit)
      return write(respond(parser_->get(), refusal(413, "a body has 64 kB at most, a mission's 4 MB")));
    if (error == http::error::header_limit)
      return write(respond(parser_->get(), refusal(431, "a head has 32 kB at most")));
    if (error) return end();
    const Request& request = parser_->get();
    if (websocket::is_upgrade(request)) return upgrade();
    if (auto response = make_response(request)) write(std::move(*response));
  }

  Guard::Admission admission_of(const Head& head) {
    return guard_.check(head, [&](std::string_view token) -> Guard::Found {
      const TimeNs now = monotonic_ns();
      const auto session = hub_.sign_ins().of(now, token);
      return {session, !session && hub_.sign_ins().is_over(now, token)};
    });
  }

  /// Nothing: it comes later.
  std::optional<Response> make_response(const Request& request) {
    const std::string_view target = view(request.target());
    const Head head = head_of(request);
    if (target.substr(0, 5) != "/api/") {
      const ApiAnswer refused = guard_.check_origin(head);
      return refused.status != 0 ? respond(request, refused) : page(request);
    }
    Guard::Admission admission = admission_of(head);
    reserve_slot(admission, ConnectionQuota::Use::request);
    if (admission.refused.status != 0 && !admission.session_ended) return respond(request, admission.refused);
    const TimeNs now = monotonic_ns();
    ApiRequest asked{.method = view(request.method_string()),
                     .target = target,
                     .body = request.body(),
                     .content_type = view(request[http::field::content_type]),
                     .session_ended = admission.session_ended};
    if (admission.session) asked.who = admission.session->who;
    ApiAnswer made = answer(asked, hub_.known());
    if (target == "/api/v1/session") wipe_body();
    const bool lands = std::ranges::any_of(made.commands, brings_down);
    // A budget is no reason to keep a drone in the air.
    if (!budget_.spend(now) && !lands) return respond(request, refusal(429, "more than 100 requests a second"));
    for (const PilotCommand& command : made.commands) {
      if (const Status taken = hub_.post_command(command); !taken)
        return respond(request, refusal(503, taken.error().message));
    }
    if (made.call) {
      const Status signed_now = hub_.keys().submit(*asked.who, *made.call);
      if (!signed_now) return respond(request, refusal(503, signed_now.error().message));
    }
    if (made.sign_out) {
      hub_.sign_ins().end(*admission.session);
      hub_.keys().on_session_over(*asked.who);
    }
    if (made.sign_in) return sign_in(now, std::move(*made.sign_in));
    if (made.mission) return ask(std::move(*made.mission));
    if (made.fault) return ask(hub_.request_fault(), std::move(*made.fault));
    return respond(request, std::move(made));
  }

  std::optional<Response> sign_in(TimeNs now, SignIn asked) {
    if (hub_.sign_ins().is_dismissed(asked.who)) return respond(parser_->get(), refusal(403, role_taken));
    const auto look_at_ns = hub_.sign_ins().next_attempt(now, asked.who, address_);
    if (!look_at_ns)
      return respond(parser_->get(),
                     refusal(429, "too many wrong pass phrases are tried for this operator: try again"));
    hub_.sign_ins().failed(asked.who, address_);  // until it is seen to be right, so that many at once are many
    wire_.tcp().expires_never();
    if (*look_at_ns <= now) {
      unlock(std::move(asked));
      return std::nullopt;
    }
    const auto timer = std::make_shared<boost::asio::steady_timer>(wire_.get_executor());
    timer->expires_after(std::chrono::nanoseconds(*look_at_ns - now));
    timer->async_wait([self = shared_from_this(), timer, asked = std::move(asked)](beast::error_code ended) mutable {
      if (!ended) self->unlock(std::move(asked));
    });
    return std::nullopt;
  }

  void unlock(SignIn asked) {
    hub_.keys().unlock(asked.who, std::move(asked.pass_phrase),
                       answers_.expect<Status>([self = shared_from_this(), who = asked.who](const Status& unlocked) {
                         self->signed_in(who, unlocked);
                       }));
  }

  /// A pass phrase was in it, and is with who unlocks the key.
  void wipe_body() {
    crypto::wipe(parser_->get().body());
    const auto behind = buffer_.prepare(buffer_.capacity() - buffer_.size());  // what was read through it
    ::explicit_bzero(behind.data(), behind.size());
  }

  std::optional<Response> ask(MissionRequest asked) {
    if (!hub_.request_mission()) return respond(parser_->get(), refusal(404, "no missions are flown here"));
    return ask(hub_.request_mission(), std::move(asked));
  }

  /// Who answers later.
  template <typename Asked>
  std::optional<Response> ask(const std::function<void(Asked, std::function<void(ApiAnswer)>)>& whom, Asked asked) {
    wire_.tcp().expires_never();
    whom(std::move(asked), answers_.expect<ApiAnswer>([self = shared_from_this()](ApiAnswer made) {
      self->write(respond(self->parser_->get(), std::move(made)));
    }));
    return std::nullopt;
  }

  void signed_in(std::size_t who, const Status& unlocked) {
    const TimeNs now = monotonic_ns();
    if (!unlocked) return write(respond(parser_->get(), refusal(403, unlocked.error().message)));
    if (hub_.sign_ins().is_dismissed(who)) {  // while his key was unlocked
      hub_.keys().on_session_over(who);
      return write(respond(parser_->get(), refusal(403, role_taken)));
    }
    const std::string token = crypto::hex(crypto::random_bytes(token_digits / 2));
    hub_.sign_ins().right(who);
    hub_.sign_ins().begin(now, who, token);
    write(respond(parser_->get(), {200, session_text(token, hub_.operators()[who])}));
  }

  void upgrade() {
    const Request& request = parser_->get();
    if (view(request.target()) != "/api/v1/stream")
      return write(respond(request, refusal(404, "the stream is /api/v1/stream")));
    const Guard::Admission admission = admission_of(head_of(request));
    if (admission.refused.status != 0) return write(respond(request, admission.refused));
    if (!reserve_slot(admission, ConnectionQuota::Use::stream))
      return write(respond(request, refusal(503, "there are too many connections from here: close one")));
    wire_.tcp().expires_never();
    serve_stream(std::move(wire_), hub_, {std::move(counted_), kept_}, admission.session, request);
  }

  /// Whether this connection may last beyond its answer; a request is answered without that.
  bool reserve_slot(const Guard::Admission& admission, ConnectionQuota::Use use) {
    const bool known = admission.refused.status == 0;
    ConnectionQuota::Owner owner{address_, {}};
    if (admission.session) owner.who = admission.session->who;
    if (known && kept_ && *kept_ == owner) return true;
    kept_.reset();
    if (!known) return false;
    kept_ = hub_.connections().reserve(owner, use);
    return kept_ != nullptr;
  }

  void write(Response response) {
    // Who has no slot asks once a connection.
    response.keep_alive(kept_ && response.keep_alive());
    const std::string_view host = view(parser_->get()[http::field::host]);
    if (wire_.tls() && host.substr(0, host.find(':')) != "localhost")
      response.set("Strict-Transport-Security", https_only);
    auto kept = std::make_shared<Response>(std::move(response));
    wire_.tcp().expires_after(timeout);
    http::async_write(wire_, *kept, [self = shared_from_this(), kept](beast::error_code error, std::size_t) {
      if (error || !kept->keep_alive()) return self->end();
      self->read();
    });
  }

  void end() {
    if (wire_.tls()) {
      wire_.tcp().expires_after(end_timeout);
      return wire_.async_shutdown([self = shared_from_this()](beast::error_code) {});
    }
    beast::error_code ignored;  // the other side may be gone already
    wire_.tcp().socket().shutdown(tcp::socket::shutdown_send, ignored);
  }

  web::Wire wire_;
  Hub& hub_;
  Answers& answers_;
  const Guard& guard_;
  Connections::Count counted_;
  Budget budget_;
  beast::flat_buffer buffer_{max_head_bytes + max_body_bytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  std::string address_;  ///< of the other side
  bool has_ended_handshake_ = false;
  Connections::Reservation kept_;  ///< of whom its newest request has shown
};

}  // namespace

void serve_http(web::Wire wire, Hub& hub, Answers& answers, const Guard& guard) {
  const auto session = std::make_shared<HttpSession>(std::move(wire), hub, answers, guard);
  hub.connections().join(std::shared_ptr<Connections::Unauthenticated>(session));
  session->start();
}

}  // namespace ledgerline::ground::service
