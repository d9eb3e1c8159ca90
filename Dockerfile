# The page on a folder of datasets, on this machine only:
#   docker build -t inspector .
#   docker run --rm -p 127.0.0.1:8080:8080 -v "$PWD":/data:ro inspector
# Any other command: docker run --rm -v "$PWD":/data:ro inspector diagnose /data/cell
# EXTRAS=page,scans adds Open3D for simulated scans, and what Debian has to bring for it; the page reads scans without.
FROM python:3.13-slim-trixie AS wheel
COPY . /source
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /wheel /source

FROM python:3.13-slim-trixie
ARG EXTRAS=page
RUN case ",$EXTRAS," in \
    *,scans,* | *,all,*) \
        apt-get update && \
        apt-get install -y --no-install-recommends \
            libegl1 libgl1 libgomp1 libidn2-0 libudev1 libusb-1.0-0 libx11-6 && \
        rm -rf /var/lib/apt/lists/* ;; \
    esac
RUN --mount=type=bind,from=wheel,source=/wheel,target=/wheel \
    python -m pip install --no-cache-dir --root-user-action ignore "$(echo /wheel/*.whl)[$EXTRAS]"
RUN useradd --create-home --uid 1000 inspector
USER inspector
WORKDIR /data
EXPOSE 8080
# Python ends at an interrupt, as at Ctrl-C; as the first process of a container it would not hear SIGTERM.
STOPSIGNAL SIGINT
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s --retries=3 \
    CMD ["python", "-c", "from urllib.request import urlopen; urlopen('http://127.0.0.1:8080/', timeout=4)"]
ENTRYPOINT ["inspector"]
# All interfaces of the container: -p 127.0.0.1:8080:8080 above is what keeps other machines out, as there is no login.
CMD ["serve", "/data", "--host", "0.0.0.0", "--port", "8080"]
