# Debian or alike, with Python 3.11, its venv module and pip.
ARG BASE_IMAGE=python:3.11-slim

FROM ${BASE_IMAGE} AS dependencies
# Where the CPU-only torch lies: a page of links, or a folder.
ARG WHEEL_INDEX=https://download.pytorch.org/whl/cpu/torch/
# The base's pip fills it from outside: it goes into the image whole, and pip would go along.
RUN python3 -m venv --without-pip /opt/venv
WORKDIR /src
# Only what names the dependencies, so that an edit of the source does not install them again.
COPY pyproject.toml .
# PyPI has the same torch with gigabytes of CUDA: "+cpu" makes pip fail rather than take that one.
RUN python3 -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" \
    | sed 's/^torch==.*/&+cpu/' > requirements.txt \
    && pip --python /opt/venv/bin/python install --find-links "${WHEEL_INDEX}" -r requirements.txt

FROM dependencies AS package
COPY . .
RUN pip --python /opt/venv/bin/python install --no-deps --prefix /package .

FROM ${BASE_IMAGE}
# By number below, too: Kubernetes' runAsNonRoot does not trust a name.
RUN useradd --uid 10001 --create-home breakaway
COPY --from=dependencies /opt/venv /opt/venv
COPY --from=package /package /opt/venv
ENV PATH=/opt/venv/bin:${PATH} BREAKAWAY_HOST=0.0.0.0
# Kernels for this CPU, for whoever runs the image; on another CPU the first start compiles them.
RUN NUMBA_CACHE_DIR=/opt/venv/share/breakaway/kernels python -m app.serving.kernels
USER 10001:10001
WORKDIR /home/breakaway
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s CMD ["python", "-m", "app.health_check"]
ENTRYPOINT ["breakaway"]
CMD ["serve"]
