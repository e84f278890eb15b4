#pragma once
#include <string>

#include "common/base/result.hpp"

/// An identity whose key never leaves the host that it was made on: the authority sees the request alone.
namespace ledgerline::crypto {

/// Who asks for a certificate. An authority may leave out, or set by itself, all of it.
struct Asker {
  std::string common_name;
  std::string organization{};   ///< O; empty: none
  std::string unit = "client";  ///< OU: "admin", "client", "peer" (NodeOUs); empty: none
};
struct KeyAndRequest {
  std::string key_pem;
  std::string request_pem;  ///< PKCS #10, "CERTIFICATE REQUEST"
};
/// With a new key of P-256.
Result<KeyAndRequest> make_request(const Asker& asker);

/// An error: one of them cannot be read, or the certificate is of another key.
Status check_fits(const std::string& key_pem, const std::string& certificate_pem);

}  // namespace ledgerline::crypto
