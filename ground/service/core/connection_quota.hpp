#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>

namespace ledgerline::ground::service {

/// Who keeps a connection. Who has shown the token needs a slot for what lasts (a stream, a connection that is kept
/// alive); a request is answered without one, so that a stop needs none. Deterministic; one thread.
///
///   operator who is signed in:  two slots of his own, then shared ones; eight at most
///   onlooker (page's token):    shared slots; eight at most for one address
class ConnectionQuota {
 public:
  /// A page has a stream and at most six connections for its requests (a browser's own bound), and somebody looks
  /// twice.
  static constexpr std::size_t max_of_one = 8;
  static constexpr std::size_t reserved = 2;  ///< of each operator: a stream, and a request beside it
  static constexpr std::size_t max_shared = 48;

  struct Owner {
    std::string address;               ///< of the other side, as address_of() has it
    std::optional<std::size_t> who{};  ///< the operator that is signed in
    bool operator==(const Owner&) const = default;
  };

  enum class Use { stream, request };
  /// False: there is none left for him. Connections that are kept for requests leave half of his slots to streams.
  bool acquire(const Owner& owner, Use use);
  void release(const Owner& owner);

 private:
  /// An operator is one wherever he connects from; his address is left out.
  static Owner key_of(const Owner& owner) { return owner.who ? Owner{"", owner.who} : owner; }
  struct Order {
    bool operator()(const Owner& a, const Owner& b) const {
      return std::tie(a.who, a.address) < std::tie(b.who, b.address);
    }
  };
  static std::size_t shared_of(const Owner& owner, std::size_t count);

  std::map<Owner, std::size_t, Order> counts_;
  std::size_t shared_ = 0;
};

/// How a connection's address is counted: an IPv6 host has a whole /64 to choose from, so that is one address.
/// `text`: as inet_ntop writes it.
std::string address_of(std::string_view text);

/// A connection that has not shown the token yet.
struct UnauthenticatedClient {
  std::string_view address;
  bool has_ended_handshake = false;  ///< TLS's; of one without TLS: false until its head is read
};

/// At so many unauthenticated clients the next one displaces one of them. At 1,000 connections a second a client keeps
/// its slot for 0.2 s or more: enough for a TLS handshake at a distance of 50 ms. With 256 one such request in a
/// hundred was displaced. Each costs a descriptor and some kB.
inline constexpr std::size_t max_unauthenticated = 384;

/// Index of whom a new unauthenticated client displaces; `all`: oldest first, not empty. Of those whose handshake has
/// not ended, if there are any, and of the addresses that have most of them, the one drawn by `random` from the older
/// half: an address that connects without end displaces its own, and no order of events makes a victim certain.
std::size_t displaced_by_next(std::span<const UnauthenticatedClient> all, std::uint64_t random);

}  // namespace ledgerline::ground::service
