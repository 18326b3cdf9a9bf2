#!/bin/sh
# Makes a certificate authority and one certificate for all processes of a Dask cluster (scheduler, workers, driver).
#
#   deploy/certificates.sh DIR [DAYS]
#
# DIR/ca.pem    what everybody trusts
# DIR/cert.pem  the cluster's certificate
# DIR/key.pem   its private key, mode 600: a reader of this file can run code on the cluster
#
# The authority's own key is deleted: certificates cannot be added later; run this again for a new cluster.
set -eu
dir=${1:?usage: certificates.sh DIR [DAYS]}
days=${2:-90}
umask 077
mkdir -p "$dir"
for name in ca.pem cert.pem key.pem; do
  if [ -e "$dir/$name" ]; then echo "$dir/$name exists already; choose another folder, or remove it" >&2; exit 2; fi
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
openssl ecparam -name prime256v1 -genkey -noout -out "$work/ca.key"
openssl req -x509 -new -key "$work/ca.key" -sha256 -days "$days" -subj "/CN=idic cluster authority" \
  -addext "basicConstraints=critical,CA:TRUE,pathlen:0" -addext "keyUsage=critical,keyCertSign" -out "$work/ca.pem"
openssl ecparam -name prime256v1 -genkey -noout -out "$work/key.pem"
openssl req -new -key "$work/key.pem" -subj "/CN=idic cluster" -out "$work/request.pem"
printf 'basicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\nextendedKeyUsage=serverAuth,clientAuth\n' \
  > "$work/extensions"
openssl x509 -req -in "$work/request.pem" -CA "$work/ca.pem" -CAkey "$work/ca.key" -CAcreateserial -sha256 \
  -days "$days" -extfile "$work/extensions" -out "$work/cert.pem" 2> "$work/log" || { cat "$work/log" >&2; exit 1; }
mv "$work/ca.pem" "$work/cert.pem" "$work/key.pem" "$dir"
chmod 700 "$dir"
chmod 600 "$dir/key.pem"
chmod 644 "$dir/ca.pem" "$dir/cert.pem"
cat <<END
certificates in $dir, valid for $days days. Driver, scheduler and workers read them from the environment:

  export DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION=true
  export DASK_DISTRIBUTED__COMM__TLS__CA_FILE=$dir/ca.pem
  for role in SCHEDULER WORKER CLIENT; do
    export DASK_DISTRIBUTED__COMM__TLS__\${role}__CERT=$dir/cert.pem DASK_DISTRIBUTED__COMM__TLS__\${role}__KEY=$dir/key.pem
  done
END
