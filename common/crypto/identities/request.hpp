#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

/// An identity whose key never leaves the host that it was made on: the authority sees the request alone.
namespace ledgerline::crypto {

/// The subject of a certificate request. An authority may leave out, or set by itself, all of it.
struct Subject {
  std::string common_name;
  std::string organization{};   ///< O; empty: none
  std::string unit = "client";  ///< OU: "admin", "client", "peer" (NodeOUs); empty: none
};
struct KeyAndRequest {
  std::string key_pem;
  std::string request_pem;  ///< PKCS #10, "CERTIFICATE REQUEST"
};
/// With a new key of P-256.
Result<KeyAndRequest> make_request(const Subject& subject);

/// An error: one of them cannot be read, or the certificate is of another key.
Status check_fits(const std::string& key_pem, const std::string& certificate_pem);

/// The certificates of a PEM text, in its order, without what stands between them.
std::vector<std::string> certificates_in(std::string_view pem);

/// These certificates with the key's own first and the others behind it in their order, since programs and peers take
/// the first for the own one, and an authority may deliver its own before it. The text as it is where it is in order.
/// An error: as check_fits, none is of that key.
Result<std::string> own_first(const std::string& key_pem, const std::string& certificates_pem);

}  // namespace ledgerline::crypto
